"""The LoCUS paper's four experiments: cells, tables, figures, and a verdict on every claim."""
