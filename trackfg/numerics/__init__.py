"""Arrays, rotations, the Earth, spans and interpolation: mathematics that knows nothing of recordings."""
