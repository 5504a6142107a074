"""Seven vehicles in a hexagon, flown from waypoint to waypoint: casting, chemotaxis, anemotaxis, fluxotaxis."""
