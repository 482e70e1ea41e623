"""One file an approach, one contract for all."""
