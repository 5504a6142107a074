"""Whole simulated surveys: processes, their files, and the report."""
