"""Samples to estimates with honest uncertainty."""
