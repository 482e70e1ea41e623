"""Readers of foreign formats: numbers and signs as they are found, and where each fact was found."""
