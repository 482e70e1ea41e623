"""The CAE model at any condition: its runs, and an emulator that interpolates between them."""
