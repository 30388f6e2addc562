"""Pages about several runs of a line: laid over each other, and what they say of it over time."""
