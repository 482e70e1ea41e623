"""Readers of exported tables: the role of each column, and the records in them."""
