"""What measured numbers mean: where the source is."""
