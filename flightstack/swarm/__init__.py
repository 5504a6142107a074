"""What drones tell each other, and what each makes of it."""
