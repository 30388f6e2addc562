"""What changed of a track: a run against a map, a map against another."""
