"""Each kind of sensor's table has one object that describes it, listed in :mod:`trackfg.io.formats.registry`."""
