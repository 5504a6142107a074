"""LoCUS: the formation searches as one body and climbs the gas gradient."""
