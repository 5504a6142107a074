"""MAVLink as agent and ground station speak it: links, frames, exchanges, the vehicle's state."""
