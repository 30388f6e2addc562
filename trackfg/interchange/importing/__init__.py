"""Recordings of other systems become recordings of trackfg: ``trackfg import`` and ``trackfg init``.

A source (a file, a folder, a zip) is read by a :class:`~trackfg.interchange.importing.source_format.SourceFormat` into
tables as they are there; a :class:`~trackfg.interchange.importing.mapping.Mapping` says which of their columns are
which sensor's, in the words of ``recording.toml``; and :mod:`trackfg.interchange.importing.conversion` writes the
recording.

====================  =========================================================================================
module                content
====================  =========================================================================================
``registry``          the formats by name, and the one that a source is of
``source_format``     what the importer must know of a format
``source_table``      a table of a source, with its columns as they are there
``unread_formats``    formats that are refused by name, each with what converts it
``sources``           a module for each format
``delimited``         delimited text
``shapes``            tables of other shapes than a column for each channel
``columns``           what the columns mean, by their names, units and values
``times``             times as numbers and as text, on one clock
``mapping``           which columns are which sensor's
``proposal``          a mapping that is proposed from the data
``proposals``         parts of it: gyro and accelerometer, tach, units by force, what is asked
``conversion``        the recording that a mapping makes of the tables
``sensors``           the table of each sensor in it
``common_clock``      the one clock of its tables
``stated_start``      dates in the lines above a table
``stations``          places along the line, as they are written
``sensor_log``        the log of an inertial sensor alone
``geometry_reading``  how a table of track geometry is read
``channels``          the result that such a table becomes
====================  =========================================================================================
"""
