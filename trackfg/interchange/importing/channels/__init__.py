"""Channel tables of track geometry, as recording cars write them, become results without a trajectory."""
