"""Repeated runs show how fast a track changes, where it jumped, and when a limit is reached."""
