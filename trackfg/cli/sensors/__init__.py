"""Commands about the sensors of a recording."""
