"""Changes of the track are found here: of a run against a map, and of a map against another."""
