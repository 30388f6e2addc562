"""``trackfg config``: the settings that there are."""

from __future__ import annotations

import json as json_text
import tomllib
from pathlib import Path
from typing import Annotated

import typer

from trackfg.cli.options import Json, out_file
from trackfg.cli.terminal import print_unless_quiet
from trackfg.errors import BadInputError


def config(
    out: Annotated[Path | None, out_file("File to write; standard output if absent.", "C.toml")] = None,
    limits: Annotated[
        str | None, typer.Option(metavar="NAME", help="A template of limits instead: en-13848-5.")
    ] = None,
    json: Json = False,
) -> None:
    """Print every setting of smooth, batch and stream with its default, its unit and what it means, for --config.

    With --limits a template is printed whose numbers are to be filled in, for --limits of other commands.
    """
    from trackfg.config import SmoothConfig
    from trackfg.files.atomic_file import write_whole
    from trackfg.geometry.limits import EN_13848_5, limit_template

    if limits not in (None, EN_13848_5):
        raise BadInputError(f"--limits {limits}: expected {EN_13848_5}")
    template = SmoothConfig.template() if limits is None else limit_template()
    if json:
        print(SmoothConfig().model_dump_json(indent=2) if limits is None else _as_json(template))
    elif out is None:
        print(template, end="")
    if out is None:
        return
    if out.exists():
        raise BadInputError(f"{out}: exists; expected a new file")
    write_whole(out, template.encode("utf-8"))
    print_unless_quiet(f"{'settings' if limits is None else 'limits'}: {out}")


def _as_json(template: str) -> str:
    """Return a template of limits as JSON, with null for the numbers that are to be filled in."""
    entries = tomllib.loads(template)["limits"]
    return json_text.dumps({"limits": [each | {"value_mm": None} for each in entries]}, indent=2)
