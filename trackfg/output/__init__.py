"""Outputs of a solved graph: trajectory, track geometry and events, each with its sigmas."""
