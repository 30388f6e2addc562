"""A stream is located on a map."""
