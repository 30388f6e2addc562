"""Places along a line: kilometrage and its notation, grids of chainage, and passes over it."""
