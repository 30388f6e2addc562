"""Where a stream is on a map."""
