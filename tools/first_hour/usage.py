"""A command line that is shown, or that cannot be run everywhere, has commands and options that there are."""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
from functools import cache
from pathlib import Path

from typer.main import get_command

from first_hour.pages import ROOT
from trackfg.cli.main import app

_SIGNS = re.compile(r"[\[\]|]|\.\.\.|\u2026")


def wrong_words(line: str) -> list[str]:
    """Return the words of a command line that its command does not know; none for other programs' commands.

    ``line`` may be a synopsis, with brackets around what may be left out.
    """
    if not re.match(r"(trackfg|python) ", line):
        return []
    words = shlex.split(_SIGNS.sub(" ", line), comments=True)
    if words[:1] == ["trackfg"]:
        return _of_trackfg(words[1:])
    if words[:1] == ["python"] and len(words) > 1 and words[1].startswith("tools/"):
        return [word for word in _options(words[2:]) if word not in _help(words[1])]
    return []


def _of_trackfg(words: list[str]) -> list[str]:
    command = get_command(app)
    while words and hasattr(command, "commands"):
        if words[0].startswith("-"):
            break
        if words[0] not in command.commands:
            return [] if words[0].isupper() else words[:1]
        command, words = command.commands[words[0]], words[1:]
    options = {name for parameter in command.params for name in (*parameter.opts, *parameter.secondary_opts)} | {
        "--help"
    }
    return [word for word in _options(words) if word not in options]


def _options(words: list[str]) -> list[str]:
    return [word.split("=")[0] for word in words if re.match(r"--?[a-z]", word)]


@cache
def _help(tool: str) -> str:
    done = subprocess.run([sys.executable, ROOT / Path(tool), "--help"], capture_output=True, text=True, check=True)
    return done.stdout
