"""The tables of a source become the table of each sensor in a recording, as a mapping says.

============================  =================================================================================
module                        content
============================  =================================================================================
``sensor_reading``            the table of a sensor, from the source's tables that a mapping names
``sensor_table``              what such a table has: times, columns, its section in the description
``sensor_columns``            the columns of a sensor, and which rows say something of it
``rows_in_order``             rows in the order of their times, without repetitions
``sample_stamps``             stamps of samples that repeat, or are out of their order
``receiver_rows``             rows of a receiver that hold, or lie between, its measurements; sigmas by quality
``two_tables``                gyro and accelerometer of two tables on the times of one
``recorded_columns``          columns in units that a recording knows
``wheel_count``               counts of a wheel that wrap around
``pulse_levels``              levels of a wheel's pulse signal
``balise_passages``           passages of balises, with their planned places
``balise_places``             where balises are planned
============================  =================================================================================
"""
