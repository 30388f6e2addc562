"""Where a stream's estimates go."""
