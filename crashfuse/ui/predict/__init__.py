"""Sections of the page Predict."""
