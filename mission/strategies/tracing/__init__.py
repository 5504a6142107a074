"""Physicomimetic swarms of any size that trace a plume: casting, chemotaxis, anemotaxis, fluxotaxis."""
