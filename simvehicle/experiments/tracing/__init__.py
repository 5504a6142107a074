"""Swarms of any size that trace plumes: the fluxotaxis paper's experiments 3 and 4, and a ranking beyond it."""
