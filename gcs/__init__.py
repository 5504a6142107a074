"""The ground station: fleet view, failure monitor, commands, plans, recording."""
