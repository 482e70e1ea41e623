"""Our own form of the data, the campaign folder: read, checked and written."""
