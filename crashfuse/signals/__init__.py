"""What a crash pulse is, and what it says: kinematics, filters, metrics, energy, occupant, rating."""
