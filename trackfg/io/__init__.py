"""Recordings read from and written to disk."""
