"""Results go to other systems: ``trackfg export``.

Each format is a :class:`~trackfg.exporting.result_format.ResultFormat`, found by :mod:`trackfg.exporting.registry`.
:mod:`trackfg.exporting.located` gives each place of the geometry its time and position, which most of them need.
"""
