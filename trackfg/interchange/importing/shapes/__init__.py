"""Tables of other shapes than a column for each channel become such tables."""
