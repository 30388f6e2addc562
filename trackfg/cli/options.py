"""Options that commands share, and commands whose options are one object."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from functools import wraps
from typing import Annotated, TypeVar

import typer

T = TypeVar("T")

Json = Annotated[bool, typer.Option("--json", help="Print JSON instead of tables.")]

LIMITS_HELP = "A table of limits (.toml), or cfr-213 (49 CFR 213), or one class of it: cfr-213-class-4."
Limits = Annotated[str | None, typer.Option("--limits", metavar="FILE|NAME", help=LIMITS_HELP, show_default=False)]
Level = Annotated[str | None, typer.Option(metavar="NAME", help="Only the limits of this level.", show_default=False)]
LineSpeed = Annotated[
    float | None,
    typer.Option(metavar="KMH", min=0.0, help="Speed of the line, for limits by speed.", show_default=False),
]

Km = Annotated[bool, typer.Option("--km", help="Show official places of the line, such as 12+345.60, too.")]
"""Official kilometrage on request: the same option of all commands that show places."""


def with_options(kind: Callable[..., T]) -> Callable[[Callable[[T], None]], Callable[..., None]]:
    """Let a command take all its options as one object, a ``kind``, whose fields are annotated as typer wants them."""

    def with_fields(run: Callable[[T], None]) -> Callable[..., None]:
        @wraps(run)
        def command(**values: object) -> None:
            run(kind(**values))

        command.__dict__["__signature__"] = inspect.signature(kind, eval_str=True)  # typer reads the options from it
        command.__annotations__ = {}
        return command

    return with_fields
