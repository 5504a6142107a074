"""Keys, certificates and what each node of a fleet is given."""
