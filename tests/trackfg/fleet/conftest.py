"""A stand-in for ``trackfg smooth`` in a batch's processes: quick, and at fault where a recording's name says so."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest

from trackfg.config import SmoothConfig
from trackfg.io.content import content_files, files_sha256
from trackfg.results.result import Result

STAND_IN = """
import sys

if "smooth" in sys.orig_argv and "-m" in sys.orig_argv:
    import os, shutil, signal, time
    from pathlib import Path
    at = sys.orig_argv.index("smooth")
    recording, result = Path(sys.orig_argv[at + 1]), Path(sys.orig_argv[at + 3])
    with Path({calls!r}).open("a") as calls:
        calls.write(recording.name + "\\n")
    print("smoothing", recording.name, flush=True)
    match recording.name.partition("-")[0]:
        case "segfault":
            os.kill(os.getpid(), signal.SIGSEGV)
        case "hang" if not (recording / "healed").exists():
            time.sleep(600)
        case "hog":
            hoard = bytearray(400_000_000)
            time.sleep(600)
        case "killed":
            os.kill(os.getpid(), signal.SIGKILL)
        case "broken":
            print("trackfg: imu.csv: column 't', row 5: not a number", file=sys.stderr)
            os._exit(2)
    shutil.copytree(Path({results!r}) / recording.name, result, dirs_exist_ok=True)
    os._exit(0)
"""
"""Python runs a module of this name when it starts, if it finds one."""


@pytest.fixture
def stand_in(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, make_result: Callable[..., Result]) -> StandIn:
    return StandIn(tmp_path, monkeypatch, make_result)


class StandIn:
    """Recordings, and what smoothing them gives; ``calls`` are the recordings that were smoothed, in order."""

    def __init__(self, folder: Path, monkeypatch: pytest.MonkeyPatch, make_result: Callable[..., Result]) -> None:
        self.folder, self._make_result = folder, make_result
        self._calls = folder / "calls"
        code = STAND_IN.format(calls=str(self._calls), results=str(folder / "prepared"))
        (folder / "site").mkdir()
        (folder / "site" / "sitecustomize.py").write_text(code)
        monkeypatch.setenv("PYTHONPATH", str(folder / "site"), prepend=os.pathsep)

    def recording(self, name: str, start: str = "2026-05-01T03:12:00Z", content: str = "t,wx\n0,1\n") -> Path:
        folder = self.folder / "recordings" / name
        folder.mkdir(parents=True, exist_ok=True)
        columns = 'gyro = ["wx", "wy", "wz"]\naccel = ["fx", "fy", "fz"]'
        toml = f'format = "trackfg-recording/1"\nid = "{name}"\nstart = {start}\n[imu]\nfile = "imu.csv"\n{columns}\n'
        (folder / "recording.toml").write_text(toml)
        (folder / "imu.csv").write_text(content)
        old = folder.stat().st_mtime - 3600.0
        for path in folder.iterdir():
            os.utime(path, (old, old))
        self.prepare(name, start=start)
        return folder

    def prepare(
        self,
        name: str,
        start: str = "2026-05-01T03:12:00Z",
        settings: SmoothConfig | None = None,
        line_sha256: str | None = None,
    ) -> None:
        """Let smoothing a recording as it is now, with these settings and this known line, give a result."""
        folder = self.folder / "recordings" / name
        facts = {
            "start": start,
            "content_sha256": "0" * 64,
            "files_sha256": files_sha256(*content_files(folder)),
            "direction": 1,
            "anchored": False,
            "mount_roll_sd_rad": 0.0,
        }
        page = {"run": facts, "settings": (settings or SmoothConfig()).model_dump(mode="json")}
        if line_sha256 is not None:
            page["line"] = {"name": "net.geojson", "content_sha256": line_sha256, "stretches": []}
        self._make_result(**page).write(self.folder / "prepared" / name)

    def heal(self, name: str) -> None:
        """Let a recording that hangs no longer do so."""
        (self.folder / "recordings" / name / "healed").touch()

    def calls(self) -> list[str]:
        return self._calls.read_text().split() if self._calls.exists() else []
