"""What every page calls."""
