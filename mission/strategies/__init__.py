"""How a swarm searches: one file or folder a strategy."""
