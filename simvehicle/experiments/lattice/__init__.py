"""The fluxotaxis paper's first study: seven vehicles in a hexagon, without obstacles and among them."""
