"""Contradictions of a recording's rows and its description become findings, by sensor.

=======================  ==============================================================================================
module                   content
=======================  ==============================================================================================
``all_contradictions``   all of them, and the estimates that they are made from
``inertial_sensor``      its axes, columns and mounting, its clocks, filters, bias and noise
``rest_throughout``      its gyro's unit where the vehicle stands throughout
``wheel``                its clock, its sense, its silence and its size
``positions``            those of satellites and fixes
``description_warning``  a warning about a key of the description
=======================  ==============================================================================================
"""
