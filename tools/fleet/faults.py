"""Faults of single runs, put into their processes from outside: trackfg's own code is as it is.

Python imports a module ``sitecustomize`` when it starts; the one written here does harm where the recording to be
smoothed has the name of a fault.
"""

from __future__ import annotations

import shutil
from pathlib import Path

KINDS = ("segfault", "hang", "hog", "broken", "unreadable")

_SITE = """
import sys

if "smooth" in sys.orig_argv and "-m" in sys.orig_argv:
    fault = sys.orig_argv[sys.orig_argv.index("smooth") + 1].rpartition("/")[2]
    if fault == "segfault":
        import ctypes
        ctypes.string_at(0)
    elif fault == "hang":
        import time
        time.sleep(3600)
    elif fault == "hog":
        hoard = []
        while True:
            hoard.append(bytearray(50_000_000))
"""


def write_faults(folder: Path, sound: Path) -> dict[str, str]:
    """Make a recording of each kind from a sound one. Returns their places; the environment needs ``folder/site``."""
    (folder / "site").mkdir(parents=True, exist_ok=True)
    (folder / "site" / "sitecustomize.py").write_text(_SITE)
    for kind in KINDS[:-1]:
        shutil.copytree(sound, folder / kind, dirs_exist_ok=True)
    (folder / "broken" / "imu.parquet").write_bytes(b"PAR1 and nothing else")
    return {**{kind: str(folder / kind) for kind in KINDS[:-1]}, "unreadable": "https://nowhere.invalid/run.zip"}
