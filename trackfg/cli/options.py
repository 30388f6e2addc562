"""Options that commands share, and commands whose options are one object."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from contextlib import nullcontext
from functools import wraps
from pathlib import Path
from typing import Annotated, Any, TypeVar

import typer

from trackfg.cli.terminal import printed_as_json, set_quiet
from trackfg.errors import BadInputError

T = TypeVar("T")
Command = TypeVar("Command", bound=Callable[..., None])

Quiet = Annotated[
    bool,
    typer.Option(
        "--quiet", "-q", help="No progress, no notes, nothing about what was written. Warnings and JSON remain."
    ),
]
Json = Annotated[bool, typer.Option("--json", help="Print JSON instead of tables.")]

LIMITS_HELP = "A table of limits (.toml), or cfr-213 (49 CFR 213), or one class of it: cfr-213-class-4."
Limits = Annotated[str | None, typer.Option("--limits", metavar="FILE|NAME", help=LIMITS_HELP, show_default=False)]
Level = Annotated[str | None, typer.Option(metavar="NAME", help="Only the limits of this level.", show_default=False)]
LineSpeed = Annotated[
    float | None,
    typer.Option(metavar="KMH", min=0.0, help="Speed of the line, for limits by speed.", show_default=False),
]


def _place_for_file(path: Path | None) -> Path | None:
    """Refuse a place where no file can be written, before anything is computed."""
    if path is not None:
        from trackfg.files.owned_folder import refuse_unwritable

        refuse_unwritable(path)
        if path.is_dir():
            raise BadInputError(f"{path}: is a folder; expected a file")
    return path


def out_file(help_text: str, metavar: str = "FILE") -> Any:
    """Return the option for the file that a command writes; folders that are missing above it are made."""
    return typer.Option("-o", "--out", metavar=metavar, help=help_text, show_default=False, callback=_place_for_file)


TableFile = Annotated[Path | None, out_file("Table to write: .csv.")]

Km = Annotated[bool, typer.Option("--km", help="Show official places of the line, such as 12+345.60, too.")]
"""Official kilometrage on request: the same option of all commands that show places."""


PORT = 8765
"""The port of pages unless another is named: always the same, so that an open page finds what is served again."""
Port = Annotated[int, typer.Option("--port", metavar="N", min=0, max=65535, help="Of the page; 0: any that is free.")]


def with_options(kind: Callable[..., T]) -> Callable[[Callable[[T], None]], Callable[..., None]]:
    """Let a command take all its options as one object, a ``kind``, whose fields are annotated as typer wants them."""

    def with_fields(run: Callable[[T], None]) -> Callable[..., None]:
        @wraps(run)
        def command(**values: object) -> None:
            run(kind(**values))

        return _with_signature(command, inspect.signature(kind, eval_str=True))

    return with_fields


class Commands(typer.Typer):
    """Commands that each take ``--quiet`` and ``--json``.

    Help is plain text: as rich markup it would lose words in brackets and break lines where the source does.
    """

    def __init__(self, **settings: Any) -> None:
        super().__init__(no_args_is_help=True, pretty_exceptions_enable=False, rich_markup_mode=None, **settings)

    def command(self, name: str | None = None, **settings: Any) -> Callable[[Command], Command]:
        """Return the decorator that makes a function a command, listed with the whole of its first sentence."""

        def register(run: Command) -> Command:
            first_sentence = inspect.cleandoc(run.__doc__ or "").partition("\n\n")[0].replace("\n", " ")
            super(Commands, self).command(name, short_help=first_sentence, **settings)(_with_output_options(run))
            return run

        return register


def _with_output_options(run: Callable[..., None]) -> Callable[..., None]:
    """Add ``--quiet``, and ``--json`` where the command has none of its own: it then prints what it tells as JSON."""
    signature = inspect.signature(run, eval_str=True)
    has_json = "json" in signature.parameters

    @wraps(run)
    def command(*, quiet: bool, **values: Any) -> None:
        if quiet:
            set_quiet(True)
        with printed_as_json() if not has_json and values.pop("json") else nullcontext():
            run(**values)

    added = {"quiet": Quiet} if has_json else {"json": Json, "quiet": Quiet}
    options = [
        inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=False, annotation=kind)
        for name, kind in added.items()
    ]
    return _with_signature(command, signature.replace(parameters=[*signature.parameters.values(), *options]))


def _with_signature(command: Callable[..., None], signature: inspect.Signature) -> Callable[..., None]:
    """Return a command whose arguments and options typer reads from a signature."""
    command.__dict__["__signature__"] = signature
    command.__annotations__ = {}
    return command
