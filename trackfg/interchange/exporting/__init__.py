"""Results go to other systems: ``trackfg export``.

Each format is a :class:`~trackfg.interchange.exporting.result_format.ResultFormat`, found by
:mod:`trackfg.interchange.exporting.registry`.
:mod:`trackfg.interchange.exporting.located` gives each place of the geometry its time and position, which most of them
need.
"""
