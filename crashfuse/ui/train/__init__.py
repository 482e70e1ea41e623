"""Sections of the page Train."""
