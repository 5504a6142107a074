"""What to do: pure decisions, geometry and plans. No I/O, no clock, no hidden randomness."""
