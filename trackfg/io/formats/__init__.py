"""What is known of each kind of sensor's table: one object per kind, listed in :mod:`trackfg.io.formats.registry`."""
