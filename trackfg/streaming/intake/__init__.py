"""The intake makes sound, sorted rows of what a source sends.

What is wrong with times is found in five places, each of which sees what those before it have settled:

===================  ==================================================================================================
module               what it finds out, and by what
===================  ==================================================================================================
``timestamps``       the middle of the sampling interval that a stamp is of; by the description
``imu_clock``        which stamps of the IMU are wrong, and whether its clock was set; by the succession of its rows
                     as they arrive
``reorder_buffer``   the same of other tables; by the IMU's clock, whose newest time is also the watermark's
``clock_jumps``      whether all clocks were set while the vehicle went on; by the tach's count, so of sorted rows in SI
                     (``jump_evidence``)
``imu_clock_jumps``  whether the IMU's clock alone was set; by the accelerations that it and another table show
===================  ==================================================================================================

Times of the stream are the sensor's plus what ``imu_clock`` and ``reorder_buffer`` add, less what ``clock_jumps`` takes
off. ``conversion``, ``row_checks`` and the faults of the IMU (:mod:`trackfg.checks.inertial.imu_faults`) see to the
values, ``interval_check`` to the unit of the IMU's times, ``gravity_check`` to the axes and units of its first rows,
``rate_check`` to the unit of its rates, ``speed_check`` to that of a receiver's speeds, ``held_rows`` to values that it
repeats, ``repeated_rows`` to those of a slow IMU; ``intake`` puts all of them in a row.
"""
