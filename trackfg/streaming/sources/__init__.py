"""Where a stream's rows come from: a recording replayed, JSON lines, MCAP."""
