"""``trackfg config``: the settings that there are."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from trackfg.cli.options import Json
from trackfg.cli.terminal import tell
from trackfg.errors import BadInputError


def config(
    out: Annotated[
        Path | None,
        typer.Option(
            "-o", "--out", metavar="C.toml", help="File to write; standard output if absent.", show_default=False
        ),
    ] = None,
    json: Json = False,
) -> None:
    """Print every setting of smooth, batch and stream with its default, its unit and what it means, for --config."""
    from trackfg.config import SmoothConfig
    from trackfg.files.atomic_file import write_whole

    if json:
        print(SmoothConfig().model_dump_json(indent=2))
    elif out is None:
        print(SmoothConfig.template(), end="")
    if out is None:
        return
    if out.exists():
        raise BadInputError(f"{out}: exists; expected a new file")
    write_whole(out, SmoothConfig.template().encode("utf-8"))
    tell(f"settings: {out}")
