"""Smoothed rows and events of a stream, once they are final."""
