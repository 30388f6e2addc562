"""Loaders of public real recordings."""
