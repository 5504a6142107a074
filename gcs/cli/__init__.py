"""The command `gcs`."""
