"""Instruments: bytes to samples, one protocol a module."""
