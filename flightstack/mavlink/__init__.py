"""One MAVLink client for agent and ground station: links, frames, exchanges, the vehicle's state."""
