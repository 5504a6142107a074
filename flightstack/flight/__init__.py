"""What one drone does: phases, guidance, homecoming, guard."""
