"""What shows results, whatever their kind: HTML, notebook, slides and figures as files, CSV and JSON."""
