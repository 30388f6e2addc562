"""Checks of a recording: each column, each sensor, and all sensors against each other."""
