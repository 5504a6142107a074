"""Instruments: bytes to samples, and samples to estimates with honest uncertainty."""
