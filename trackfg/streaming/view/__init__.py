"""A running stream is watched in a browser on the same machine."""
