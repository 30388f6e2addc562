"""Exchange with other systems, measured: imports, exports and what a run loses on the way."""
