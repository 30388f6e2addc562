"""Formats of results that trackfg writes, one module each."""
