"""trackfg: railway track geometry and train positioning by factor-graph smoothing.

>>> import trackfg
>>> recording = trackfg.read_recording("run")
>>> result = trackfg.smooth(recording)
>>> result.write("out")

``import trackfg`` is cheap: what stands below is imported from its module when it is first used.
"""

from typing import TYPE_CHECKING

from trackfg._version import __version__
from trackfg.errors import BadInputError, TrackfgError, UnsolvableError
from trackfg.late_names import late_names

if TYPE_CHECKING:
    from trackfg.check import check_recording
    from trackfg.config import SmoothConfig
    from trackfg.plot import plot_trajectory
    from trackfg.recording import Recording
    from trackfg.recording_io import read_recording, write_recording
    from trackfg.results import Result
    from trackfg.smoother import smooth
    from trackfg.streaming.fixed_lag import FixedLagSmoother
    from trackfg.strip_chart import plot_geometry

__all__ = [
    "BadInputError",
    "FixedLagSmoother",
    "Recording",
    "Result",
    "SmoothConfig",
    "TrackfgError",
    "UnsolvableError",
    "__version__",
    "check_recording",
    "plot_geometry",
    "plot_trajectory",
    "read_recording",
    "smooth",
    "write_recording",
]

__getattr__ = late_names(
    __name__,
    {
        "FixedLagSmoother": "streaming.fixed_lag",
        "Recording": "recording",
        "Result": "results",
        "SmoothConfig": "config",
        "check_recording": "check",
        "plot_geometry": "strip_chart",
        "plot_trajectory": "plot",
        "read_recording": "recording_io",
        "smooth": "smoother",
        "write_recording": "recording_io",
    },
)


def __dir__() -> list[str]:
    return sorted(__all__)
