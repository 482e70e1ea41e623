"""Tabs of the Predict page: each is a function of an answer, and a line in the page's table of tabs."""
