"""Checks of the inertial sensor's own samples."""
