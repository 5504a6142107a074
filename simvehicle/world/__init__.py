"""Where the air goes, what is in it and what stands in it: fields over positions and time."""
