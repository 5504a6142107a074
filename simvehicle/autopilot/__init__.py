"""The simulated autopilots: what a companion computer or a ground station meets on a link."""
