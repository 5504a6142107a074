"""The balanced tree over a formation's slots."""
