"""A real run is what a loader of a public data set returns; its files are opened here."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from trackfg.errors import BadInputError
from trackfg.recording.model import Recording


@dataclass(frozen=True)
class RealRun:
    """A real recording and, apart from it, what it may be compared with.

    ``reference`` has ``t_s`` on the recording's clock and any of the trajectory columns ``east_m, north_m, up_m,
    speed_mps, roll_rad, pitch_rad, yaw_rad``. Its positions are in the recording's GNSS frame.
    """

    recording: Recording
    reference: pd.DataFrame


def existing_files(folder: Path | str, names: tuple[str, ...], what: str) -> list[Path]:
    """Return the paths of ``names`` in ``folder``. Raises :class:`BadInputError` that lists what is missing."""
    base = Path(folder)
    missing = [name for name in names if not (base / name).is_file()]
    if missing:
        raise BadInputError(f"{base}: expected {what}; missing: {', '.join(missing)}")
    return [base / name for name in names]
