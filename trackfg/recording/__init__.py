"""A recording in memory: its description, its canonical tables and the findings about it."""
