"""File access: bounded reading of untrusted files, atomic writing of our own."""
