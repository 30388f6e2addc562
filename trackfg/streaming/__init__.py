"""The smoother on a stream: rows come as they are measured, estimates go out at once and when they leave the lag.

======================  ===============================================================================================
module                  content
======================  ===============================================================================================
``sources``             batches of rows: a recording replayed, JSON lines, MCAP files
``rows``                :class:`~trackfg.streaming.rows.Rows`, canonical rows of all tables
``intake``              from a source's batches to complete, sound rows in the order of time
``events``              what happened, and where every row went that was not passed on
``window``              the factor graph of the newest keyframes
``tables``              smoothed tables and events of what left the window
``locating``            where the stream is on a map
``fixed_lag``           :class:`~trackfg.streaming.fixed_lag.FixedLagSmoother`: rows in, estimates out
``outages``             times without any rows that are too long to be bridged
``stream_tests``        all tests of a stream's own sigmas, which these are:
``sigma_test``          whether smoothed and filtered estimates differ by more than their sigmas
``track_cells``         smoothed rows on a grid along the way
``roll_test``           whether the mean roll on straights is zero
``lean_test``           whether a sensor that is declared rigid leans in curves
``vibration_test``      whether the sensor vibrates by more than the track's sigmas
``accelerometer_test``  whether the accelerometer is later than the gyro
``bandwidth_test``      whether the sensor is too slow for the waves of the track
``axle_test``           whether the sensor is on a frame of two axles
``fix_delay_test``      whether fixes are late
``cut_test``            whether a body on springs may have cut curves
``doubts``              when a stream reports what it doubts
``far_priors``          whether a clock or the accelerometer is off by more than was declared
``back_pressure``       sparser keyframes while rows come faster than they can be handled
``sinks``               where estimates go: JSON lines, a callback, Parquet parts
``run``                 all of it in a row
``checkpoint``          the file from which an interrupted stream is resumed
``view``                a running stream in a browser
======================  ===============================================================================================
"""
