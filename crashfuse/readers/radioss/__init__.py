"""Readers of OpenRadioss and Radioss runs: their time histories (``<run>T01``) and the CSV of their converter."""
