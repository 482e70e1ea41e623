"""What a result looks like: tables, files, figures and reports."""
