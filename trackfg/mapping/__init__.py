"""What runs say together about a line: recognised, joined into a map, and told where it changed."""
