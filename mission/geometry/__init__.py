"""Frames, the geofence and formations."""
