"""Results go to other systems: ``trackfg export``.

======================  ===============================================================================================
module                  content
======================  ===============================================================================================
``export``              a result becomes a file of a format
``result_format``       what a format is
``registry``            all formats by name
``formats``             the formats, one or some of a kind a module
``located_tables``      tables of a result with the time and the position of each row, which most formats need
``channels``            channel files of recording cars by a template
``rail_bands``          level and alignment of each rail in bands
``alignment_elements``  straights, transitions and circles of curves, laid end to end
======================  ===============================================================================================
"""
