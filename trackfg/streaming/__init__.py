"""The smoother on a stream: rows come as they are measured, estimates go out at once and when they leave the lag.

==================  ===================================================================================================
module              content
==================  ===================================================================================================
``sources``         batches of rows: a recording replayed, JSON lines, MCAP files
``rows``            :class:`~trackfg.streaming.rows.Rows`, canonical rows of all tables
``intake``          from a source's batches to complete, sound rows in the order of time
``events``          what happened, and where every row went that was not passed on
``window``          the factor graph of the newest keyframes
``tables``          smoothed tables and events of what left the window
``locating``        where the stream is on a map
``fixed_lag``       :class:`~trackfg.streaming.fixed_lag.FixedLagSmoother`: rows in, estimates out
``estimates``       filtered, smoothed and geometry rows, and events
``outages``         times without any rows that are too long to be bridged
``doubts``          tests of the stream's own sigmas
``back_pressure``   sparser keyframes while rows come faster than they can be handled
``sinks``           where estimates go: JSON lines, a callback, Parquet parts
``run``             all of it in a row
``stream_counts``   rows that came, were used and were lost
``growable_array``  arrays that grow at their end
``checkpoint``      the file from which an interrupted stream is resumed
``view``            a running stream in a browser
==================  ===================================================================================================
"""
