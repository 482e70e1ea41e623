"""The paper's time domain (Sect. 3.1): networks trained on the CAE runs, fine-tuned on the tests."""
