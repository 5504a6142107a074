"""The LoCUS paper's four experiments."""
