"""The CAE model at any condition: its runs, and an emulator between them."""
