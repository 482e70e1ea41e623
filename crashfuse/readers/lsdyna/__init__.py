"""LS-DYNA's histories, in ``binout`` or ``nodout``."""
