"""Plans, fences and parameters of one vehicle."""
