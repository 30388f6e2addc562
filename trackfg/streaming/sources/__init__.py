"""The rows of a stream come from a recording that is replayed, JSON lines or MCAP."""
