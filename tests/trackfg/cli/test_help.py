"""What ``--help`` says is understood where it stands: an option is named, not only described."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from typer.main import get_command

from trackfg.cli.main import app

UNITS = {"KMH": "km/h", "GB": "GB", "MM": "mm", "M": " m"}
"""What the help of an option with a number of this kind has in it."""


def options(command: Any, name: str) -> Iterator[tuple[str, Any]]:
    for part, below in getattr(command, "commands", {}).items():
        yield from options(below, f"{name} {part}")
    for option in command.params:
        if option.param_type_name == "option":
            yield f"{name} {option.opts[0]}", option


def test_help_names_what_an_option_is() -> None:
    texts = {name: option.help or "" for name, option in options(get_command(app), "trackfg")}
    assert len(texts) > 100
    unnamed = {name: text for name, text in texts.items() if text.partition(" ")[0] in {"", "Of", "For", "Its", "From"}}
    assert not unnamed


def test_help_names_the_unit() -> None:
    for name, option in options(get_command(app), "trackfg"):
        unit = UNITS.get(option.metavar or "")
        assert unit is None or unit in (option.help or ""), name
