"""Analyses of a campaign: studies with tests left out, predictions, sweeps, recommendations, next tests."""
