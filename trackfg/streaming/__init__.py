"""The smoother on a stream: rows come as they are measured, estimates go out at once and when they leave the lag.

=======================  =============================================================================================
module                   content
=======================  =============================================================================================
``sources``              batches of rows: a recording replayed; ``json_lines_source``, ``mcap_source``
``rows``                 :class:`Rows`, canonical rows of all tables
``intake``               from a source's batches to complete, sound rows: ``stamps``, ``arrival``, ``conversion``,
                         ``row_checks``
``imu_clock``            the clock of the stream
``stream_events``        what happened, and where every row went that was not passed on
``tape``                 the rows that are still needed
``increment``            the next keyframe and its factors, by those of the batch smoother; ``odometer`` its wheel
``window``               the graph of the newest keyframes; ``moving_window`` takes it along
``history``              keyframes that left it, estimated from all that came since; ``smoothed`` their tables
``map_locator``          where it is on a map, by its ``seen_track``; ``late_places`` tells the window
``fixed_lag``            :class:`FixedLagSmoother`: rows in, estimates out
``sinks``                where estimates go: JSON lines, a callback; ``parquet_parts``
``run``                  all of it in a row
``checkpoint``           the file from which a killed stream goes on; ``snapshot``: objects to the last bit;
                         ``json_numbers``
=======================  =============================================================================================
"""
