"""Recordings with a known answer: a simulated railway world, and loaders of public real recordings.

* :func:`simulate` runs one of :func:`scenarios`, or a :class:`Scenario` of your own: a recording and its truth.
* ``trackfg.datasets.real.kitti``, ``.kingston`` and ``.comma2k19`` each have a ``load`` that gives a :class:`RealRun`.
* :func:`drop_imu` and :func:`drop_tach` damage a recording, :func:`slip_wheel` a simulated run.

Nothing here is shared with the estimators but frames, units and the recording's tables. See docs/datasets.md.
"""

from trackfg.datasets.faults import drop_imu, drop_tach, slip_wheel
from trackfg.datasets.real.real_run import RealRun
from trackfg.datasets.scenarios import Scenario, Simulation, scenarios, simulate

__all__ = ["RealRun", "Scenario", "Simulation", "drop_imu", "drop_tach", "scenarios", "simulate", "slip_wheel"]
