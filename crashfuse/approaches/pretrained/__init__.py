"""A network that was trained once on thousands of simulated vehicles, and reads the tests of this one."""
