"""Import of foreign files on the Data page."""
