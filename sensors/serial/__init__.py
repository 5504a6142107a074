"""Serial ports, what is on them, and recordings of them."""
