"""The fused approach (beyond the paper): both domains and the raw CAE model, weighted by left-out tests."""
