"""Readers of foreign formats: numbers and signs as found in the file, with the origin of each fact."""
