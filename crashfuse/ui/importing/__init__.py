"""The import of foreign files on the page Data."""
