"""Presentation of results: tables, files, figures and reports."""
