"""Beyond the paper: both approaches and the raw CAE model, weighted by left-out tests."""
