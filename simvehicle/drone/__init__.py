"""Simulated drones without any I/O: vehicle, instruments and faults, advanced together."""
