"""The report: one HTML file that needs no network, opens anywhere and can be printed."""
