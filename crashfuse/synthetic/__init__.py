"""The simulated lumped-parameter vehicle behind the sample campaign; not a real car."""
