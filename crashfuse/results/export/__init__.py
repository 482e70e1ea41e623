"""Pulses for other programs: ISO-MME and curves of solvers."""
