"""Infotaxis: robots that go where they expect to learn most about the source, each for itself or together."""
