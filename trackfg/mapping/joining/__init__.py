"""Runs are joined into a map here: each is condensed to rows on the map's variables, and all are solved together."""
