"""The fixed-lag smoother's core: a factor graph of the newest keyframes that moves along a stream.

The **window** holds the keyframes of the last ``lag_s`` seconds and those added since the last pass, at most ten, with
the factors of the batch smoother, numbered from the oldest one. Three things happen to it:

1. **Filter step** (:mod:`~trackfg.streaming.window.filter_step`), once per keyframe. The newest keyframe carries all
   older measurements as one Gaussian factor on itself and the shared variables, its **marginal prior**. The next
   keyframe is predicted by the inertial sensor, and one Gauss-Newton step of these two is the extended Kalman filter's
   update, and smooths the older keyframe by one step: it gives the filtered row. The step leaves a conditional of the
   older keyframe on the newer one.
2. **Relinearisation pass** (:mod:`~trackfg.streaming.window.running_window`), every tenth keyframe.
   **Back-substitution** along those conditionals (Rauch, Tung and Striebel) gives states of the whole window; at these,
   the new **linearisation point**, all factors but the marginal prior are linearised and robust weights computed anew,
   and the window takes a Gauss-Newton step.
3. **Marginalisation**, in the same pass. Keyframes older than the lag are eliminated by QR. What they contribute to the
   rest becomes the marginal prior of the first keyframe that stays, fixed at its linearisation point; their own
   conditionals are kept (:mod:`~trackfg.streaming.window.marginalised`), so that back-substitution reaches them later.

The running window keeps the same keyframes as three graphs, and the intervals that were added since the last pass::

    window p-x--x--x--x--x--x--x             all keyframes at the last pass, as that left them
    recent                p-x--x             the last two of these; all while the heading is unknown
    added                      x--o--o--o    the intervals since, kept apart until the next pass
    newest                            p-o    the newest keyframe alone

Each ``p`` is a marginal prior: everything measured on the left of it.

``newest`` takes the filter step; ``recent`` takes it where that one is not trusted; ``window`` takes the pass.
:class:`~trackfg.streaming.fixed_lag.FixedLagSmoother` owns a ``MovingWindow``; that owns a ``RunningWindow`` once it
has begun, and this the three graphs. For each keyframe ``prepare``, ``add_keyframe`` and ``relinearise_if_due`` are
called, in this order.

In reading order:

====================  =================================================================================================
module                content
====================  =================================================================================================
``window``            the graph: ``Window``, ``Interval`` from one keyframe to the next, ``WindowStep``,
                      ``MarginalisedKeyframes``
``moving_window``     the window's life: not yet begun, running, lost and begun anew
``starting_window``   the first window of a stream, solved as a batch
``running_window``    filter steps and relinearisation passes
``window_solver``     the steps of a pass, and the batch solver that takes over where they do not settle
``next_interval``     prediction and factors of the next interval, by the batch smoother's functions
``predicted_motion``  the motion over that interval, as its inertial samples measure and predict it
``interval_factors``  families of one interval, filled with its numbers
``tach_interval``     what a wheel rolls over that interval, as factors
``filter_step``       the Gauss-Newton step of two keyframes, a Kalman filter's update
``fix_voting``        which of contradicting fixes are followed
``wheel_creep``       whether the wheel crept, as a fix or the accelerometer shows it
``records``           how good the sensors are, from their residuals
``rests``             standstills, while they last
``marginalised``      keyframes that left the window and are still needed by the tables
``sample_buffer``     the rows that are still needed
``tach_buffer``       the newest rows of the tach, signed, and their resolution
``stream_context``    what is constant along a stream
====================  =================================================================================================
"""
