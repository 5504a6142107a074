"""Wind and gas."""
