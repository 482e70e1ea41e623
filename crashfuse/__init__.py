"""crashfuse: fuse CAE crash pulses with a handful of physical tests, and prove how good the result is."""
