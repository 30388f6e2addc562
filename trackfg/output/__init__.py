"""What a solved graph says: trajectory, track geometry, events, each with its sigmas."""
