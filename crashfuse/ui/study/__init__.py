"""Tabs of the Study page: each is a module with a function ``show``, and a line in the page's table of tabs."""
