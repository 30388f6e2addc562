"""Recordings of other systems become recordings of trackfg: ``trackfg import`` and ``trackfg init``.

A source (a file, a folder, a zip) is read by a :class:`~trackfg.interchange.importing.source_format.SourceFormat` into
tables as they are there; a :class:`~trackfg.interchange.importing.mapping.Mapping` says which of their columns are
which sensor's, in the words of ``recording.toml``; and :mod:`trackfg.interchange.importing.conversion` writes the
recording.
"""
