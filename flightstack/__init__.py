"""The agent on the drone's companion computer."""
