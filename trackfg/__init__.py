"""trackfg: railway track geometry and train positioning by factor-graph smoothing.

>>> import trackfg
>>> recording = trackfg.read_recording("run1")
>>> result = trackfg.smooth(recording)
>>> folder = result.write("out1")

``import trackfg`` is cheap: what stands below is imported from its module when it is first used.
"""

from typing import TYPE_CHECKING

from trackfg._version import __version__
from trackfg.errors import BadInputError, TrackfgError, UnsolvableError
from trackfg.lazy_imports import lazy_imports

if TYPE_CHECKING:
    from trackfg.config import SmoothConfig
    from trackfg.io.check import check_recording
    from trackfg.io.reader import read_recording, write_recording
    from trackfg.numerics.bounded_memory import bounded_memory
    from trackfg.plots.strip_chart import plot_geometry
    from trackfg.plots.trajectory_chart import plot_trajectory
    from trackfg.recording.model import Recording
    from trackfg.results.result import Result
    from trackfg.smoothing.smoother import smooth
    from trackfg.streaming.fixed_lag import FixedLagSmoother

__all__ = [
    "BadInputError",
    "FixedLagSmoother",
    "Recording",
    "Result",
    "SmoothConfig",
    "TrackfgError",
    "UnsolvableError",
    "__version__",
    "bounded_memory",
    "check_recording",
    "plot_geometry",
    "plot_trajectory",
    "read_recording",
    "smooth",
    "write_recording",
]

__getattr__ = lazy_imports(
    __name__,
    {
        "FixedLagSmoother": "streaming.fixed_lag",
        "Recording": "recording.model",
        "Result": "results.result",
        "SmoothConfig": "config",
        "bounded_memory": "numerics.bounded_memory",
        "check_recording": "io.check",
        "plot_geometry": "plots.strip_chart",
        "plot_trajectory": "plots.trajectory_chart",
        "read_recording": "io.reader",
        "smooth": "smoothing.smoother",
        "write_recording": "io.reader",
    },
)


def __dir__() -> list[str]:
    return sorted(__all__)
