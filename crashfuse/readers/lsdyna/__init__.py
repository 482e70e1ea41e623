"""Readers of LS-DYNA's nodal histories in ``binout`` or ``nodout``."""
