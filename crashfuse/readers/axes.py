"""The axes of a file, and directions along them."""

from typing import Literal, get_args

AXES = "xyz"
Travel = Literal["x", "-x", "y", "-y", "z", "-z"]
"""A direction in the file's own axes."""
TRAVELS: tuple[Travel, ...] = get_args(Travel)
