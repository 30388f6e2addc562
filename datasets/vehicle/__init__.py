"""A simulated vehicle is driven, slips, and moves on its suspension."""
