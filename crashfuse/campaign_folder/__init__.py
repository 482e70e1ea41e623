"""The campaign folder, crashfuse's own data format: reading, checking and writing."""
