"""The operator's commands to the swarm."""
