"""What the columns of a foreign table mean, by names, units and values."""
