"""Commands that import recordings of other systems."""
