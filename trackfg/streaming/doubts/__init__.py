"""Tests of a stream's own sigmas, in place of the verdict on a run (:mod:`trackfg.smoothing.doubts`).

A stream has written its rows before their sigmas can be tested. So each test takes what is written and measured, piece
by piece, into sums of constant size, and says at any time which sigmas were too small so far, and why.

======================  ===============================================================================================
module                  content
======================  ===============================================================================================
``stream_tests``        all tests in a row
``reporting``           when doubts are looked for, and which of them are new
``track_cells``         smoothed rows on a grid along the way, which two of the tests take
``sigma_test``          differences between smoothed and filtered estimates, and innovations of fixes
``far_priors``          clocks, an accelerometer and a lever arm that are off by more than was declared
``fix_delay_test``      fixes that are late
``shared_error_test``   an error that positions may share
``roll_test``           mean roll on straights
``lean_test``           lean in curves of a sensor that is declared rigid
``cut_test``            curves that a body on springs may have cut
``tach_test``           a tach that contradicts all other sensors
``rest_count_test``     a tach that counts while the vehicle rests
``vibration_test``      vibration of the sensor against the track's short waves
``accelerometer_test``  an accelerometer that is later than the gyro
``bandwidth_test``      a sensor that is too slow for the waves of the track
``axle_test``           a sensor on a frame of two axles, or with motion of its own
======================  ===============================================================================================

What the window itself learns of noise, positions and walking biases (:mod:`trackfg.streaming.window`) is doubted there.
"""
