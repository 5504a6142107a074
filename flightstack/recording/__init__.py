"""Flight recordings, replay, and clocks."""
