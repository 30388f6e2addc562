"""Shells complete what the command line takes: asked as they ask, of the program that a user has."""

from __future__ import annotations

import os
import shlex
import subprocess
import sys

import pytest


def completed(words: str, position: int) -> list[str]:
    """What bash would offer for the word at ``position`` of a line."""
    environment = os.environ | {"_TRACKFG_COMPLETE": "complete_bash", "COMP_WORDS": words, "COMP_CWORD": str(position)}
    done = subprocess.run(
        [sys.executable, "-m", "trackfg"], env=environment, capture_output=True, text=True, check=False
    )
    assert done.stderr == ""
    return done.stdout.split()


@pytest.mark.parametrize(
    ("words", "position", "expected"),
    [
        ("trackfg smo", 1, ["smooth"]),
        ("trackfg map b", 2, ["build"]),
        ("trackfg stream --real", 2, ["--real-time"]),
        ("trackfg simulate mainline-g", 2, ["mainline-gnss"]),
    ],
)
def test_commands_options_and_scenarios_are_completed(words: str, position: int, expected: list[str]) -> None:
    assert completed(words, position) == expected


def test_the_shell_learns_how() -> None:
    """The shell is the one that runs the command."""
    command = f"{shlex.quote(sys.executable)} -m trackfg --show-completion; exit $?"
    done = subprocess.run(["bash", "-c", command], capture_output=True, text=True, check=False)
    assert done.returncode == 0
    assert "_TRACKFG_COMPLETE=complete_bash" in done.stdout
