"""Commands do all their work where there is no network, not even this machine's own."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ALONE = ("unshare", "--net", "--map-root-user")
COMMANDS = (
    "simulate mainline-gnss --duration 100 -o run",
    "check run",
    "smooth run -o out",
    "stream run -o streamed",
    "batch run -o store --line 7 --jobs 1",
    "report out --recording run -o page.html",
    "plot out -o chart.html",
    "limits out --limits cfr-213-class-4",
    "map build out -o line.gpkg",
    "export out --to landxml -o plan.xml",
    "export out --to csv -o table.csv",
    "compare run -o compared",
)
RUN = """
import sys
from trackfg.cli.main import main
for command in sys.argv[1:]:
    sys.argv = ["trackfg", *command.split()]
    try:
        main()
    except SystemExit as end:
        if end.code:
            sys.exit(f"{command}: {end.code}")
"""
"""Runs commands one after another: an interpreter for each takes longer to start than most of them do."""


def alone(command: list[str], folder: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run([*ALONE, *command], cwd=folder, capture_output=True, text=True, check=False)


@pytest.mark.slow
def test_no_network_is_needed(tmp_path: Path) -> None:
    if shutil.which("unshare") is None or alone(["true"], tmp_path).returncode != 0:
        pytest.skip("no namespace without a network can be made here: unshare --net is not there or not permitted")
    connect = "import socket; socket.create_connection(('127.0.0.1', 9))"
    assert "unreachable" in alone([sys.executable, "-c", connect], tmp_path).stderr
    done = alone([sys.executable, "-c", RUN, *COMMANDS], tmp_path)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / COMMANDS[-1].split()[-1]).is_dir()
