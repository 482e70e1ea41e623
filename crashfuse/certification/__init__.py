"""Certification by analysis: acceptance criteria, a matrix of conditions, verdicts, record of left-out tests."""
