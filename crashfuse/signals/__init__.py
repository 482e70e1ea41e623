"""The crash pulse and what is computed from it: kinematics, filters, metrics, energy, occupant, rating."""
