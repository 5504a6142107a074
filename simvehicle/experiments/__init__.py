"""The papers' experiments: cells of trials, tables, figures, and a verdict on every claim."""
