"""Files that are safe to trust: bounded reading of what strangers wrote, whole writing of our own."""
