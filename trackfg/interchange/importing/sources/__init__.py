"""Formats of recordings that trackfg reads, one module each."""
