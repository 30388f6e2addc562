"""Options that commands share, commands whose options are one object, and their help.

Help is plain text: commands by what they are for, arguments by the names that the usage line has. As rich markup it
would lose words in brackets and break lines where the source does; typer's own plain text shows the types of Python
beside arguments.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext
from functools import wraps
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

import typer
from typer.core import TyperCommand, TyperGroup

from trackfg.cli.freed_memory import without_collection
from trackfg.cli.quick_imports import quick_imports
from trackfg.cli.terminal import printed_as_json, set_quiet, working
from trackfg.errors import BadInputError
from trackfg.files.atomic_folder import real_path

if TYPE_CHECKING:
    from trackfg.geometry.limits import LimitChoice
    from trackfg.maps.feature_map import FeatureMap

T = TypeVar("T")
Command = TypeVar("Command", bound=Callable[..., None])

Quiet = Annotated[
    bool,
    typer.Option(
        "--quiet", "-q", help="No progress, no notes, nothing about what was written. Warnings and JSON remain."
    ),
]
Json = Annotated[bool, typer.Option("--json", help="Print JSON instead of tables.")]

RecordingFolder = Annotated[Path, typer.Argument(metavar="REC", help="Folder of the recording.")]
ResultFolder = Annotated[Path, typer.Argument(metavar="OUT", help="Folder of the result.")]
Config = Annotated[Path | None, typer.Option(metavar="C.toml", help="Settings other than the defaults.")]
LIMITS_HELP = "A table of limits (.toml), or cfr-213 (49 CFR 213), or one class of it: cfr-213-class-4."
Limits = Annotated[str | None, typer.Option("--limits", metavar="FILE|NAME", help=LIMITS_HELP)]
Level = Annotated[str | None, typer.Option(metavar="NAME", help="Only the limits of this level.")]
LineSpeed = Annotated[
    float | None, typer.Option(metavar="KMH", min=0.0, help="Speed of the line, km/h, for limits by speed.")
]


def limit_choice(source: str | None, level: str | None, line_speed: float | None) -> LimitChoice | None:
    """Return what a command's options say of limits, None for nothing; a level or a speed without limits is refused."""
    from trackfg.geometry.limits import LimitChoice

    if source is not None:
        return LimitChoice(source, level, line_speed)
    if level is not None or line_speed is not None:
        raise BadInputError("--level and --line-speed choose among limits: expected --limits too")
    return None


def _place_for_file(path: Path | None) -> Path | None:
    """Refuse a place where no file can be written, before anything is computed."""
    if path is not None:
        from trackfg.files.owned_folder import refuse_unwritable

        refuse_unwritable(path)
        if path.is_dir():
            raise BadInputError(f"{path}: is a folder; expected a file")
    return path


def refuse_inside(result: Path, path: Path) -> None:
    """Refuse a file to be written within a result's folder."""
    if real_path(path).parent == real_path(result):
        raise BadInputError(f"{path}: lies in the result, which holds nothing but its own files: choose another place")


def out_file(help_text: str, metavar: str = "FILE") -> Any:
    """Return the option for the file that a command writes; folders that are missing above it are made."""
    return typer.Option("-o", "--out", metavar=metavar, help=help_text, callback=_place_for_file)


TableFile = Annotated[Path | None, out_file("Table to write: .csv.")]

Km = Annotated[
    bool | None,
    typer.Option(
        "--km/--no-km",
        help="Show official places, such as 12+345.60. They are shown by default where the line has them.",
    ),
]
"""Official kilometrage: the same option of all commands that show places."""


PORT = 8765
"""The port of pages unless another is named: always the same, so that an open page finds what is served again."""
Port = Annotated[
    int, typer.Option("--port", metavar="N", min=0, max=65535, help="Port of the page; 0: any that is free.")
]


def newest_map(location: str | None) -> FeatureMap | None:
    """Return the newest version of the map that is named, if any. What reads maps takes long to import."""
    if location is None:
        return None
    from trackfg.maps import read_map

    return read_map(location)


def with_options(kind: Callable[..., T]) -> Callable[[Callable[[T], None]], Callable[..., None]]:
    """Let a command take all its options as one object, a ``kind``, whose fields are annotated as typer wants them."""

    def with_fields(run: Callable[[T], None]) -> Callable[..., None]:
        @wraps(run)
        def command(**values: object) -> None:
            run(kind(**values))

        return _with_signature(command, inspect.signature(kind, eval_str=True))

    return with_fields


SECTIONS = {
    "To begin with": ("demo", "scenarios", "simulate"),
    "Recordings": ("init", "import", "check", "noise"),
    "Smoothing": ("smooth", "batch", "stream", "config"),
    "Results": ("report", "limits", "plot", "statistics", "export", "browse"),
    "Several runs of a line": ("map", "overlay", "balises"),
    "Other systems": ("compare", "baseline", "estimators"),
}
"""What the help of trackfg lists, and in which order."""


class PlainCommand(TyperCommand):
    """A command whose help names its arguments as a user writes them."""

    def collect_usage_pieces(self, ctx: Any) -> list[str]:
        """Return what the usage line has after the command's name: what may be left out is in brackets."""
        arguments = [param for param in self.get_params(ctx) if param.param_type_name == "argument"]
        names = (_name(param) if param.required else f"[{_name(param)}]" for param in arguments)
        return [*([self.options_metavar] if self.options_metavar else []), *names]

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Write arguments and options, one below the other."""
        rows: dict[str, list[tuple[str, str]]] = {"Arguments": [], "Options": []}
        for param in self.get_params(ctx):
            record = param.get_help_record(ctx)
            if record is None:
                continue
            if param.param_type_name == "argument":
                rows["Arguments"].append((_name(param), record[1]))
            else:
                rows["Options"].append(record)
        _write_sections(formatter, rows)


class PlainGroup(TyperGroup):
    """A group of commands, listed by :data:`SECTIONS`; those that no section has stand at the end."""

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write the sections of commands."""
        commands = {name: self.get_command(ctx, name) for name in self.list_commands(ctx)}
        width = max(map(len, commands))
        texts = {
            name: command.get_short_help_str(formatter.width - 6 - width)
            for name, command in commands.items()
            if command is not None and not command.hidden
        }
        rows = {
            heading: [(name.ljust(width), texts.pop(name)) for name in names if name in texts]
            for heading, names in SECTIONS.items()
        }
        _write_sections(formatter, {**rows, "Commands": [(name.ljust(width), text) for name, text in texts.items()]})


def _name(argument: Any) -> str:
    """Return an argument as a user sees it: ``REC``, or ``RUN...`` where several may be given."""
    return f"{argument.metavar or argument.name.upper()}{'' if argument.nargs == 1 else '...'}"


def _write_sections(formatter: Any, rows: Mapping[str, Sequence[tuple[str, str]]]) -> None:
    for heading, records in rows.items():
        if records:
            with formatter.section(heading):
                formatter.write_dl(records)


class Commands(typer.Typer):
    """Commands that each take ``--quiet`` and ``--json``, with help as plain text."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(
            no_args_is_help=True, pretty_exceptions_enable=False, rich_markup_mode=None, cls=PlainGroup, **settings
        )

    def command(
        self, name: str | None = None, *, example: str = "", loads: str | None = None, **settings: Any
    ) -> Callable[[Command], Command]:
        """Return the decorator that makes a function a command, listed with the whole of its first sentence.

        ``example`` is a line to type. ``loads`` is the module that the command imports for a second or more: a bar
        shows meanwhile that it has begun.
        """

        def register(run: Command) -> Command:
            first_sentence = inspect.cleandoc(run.__doc__ or "").partition("\n\n")[0].replace("\n", " ")
            shown: dict[str, Any] = {"short_help": first_sentence, "epilog": f"Example: {example}", "cls": PlainCommand}
            super(Commands, self).command(name, **shown, **settings)(_with_output_options(run, loads))
            return run

        return register


def _with_output_options(run: Callable[..., None], loads: str | None) -> Callable[..., None]:
    """Add ``--quiet``, and ``--json`` where the command has none of its own: then its lines and tables are JSON.

    The module that it ``loads`` is imported before it runs.
    """
    signature = inspect.signature(run, eval_str=True)
    has_json = "json" in signature.parameters

    @wraps(run)
    def command(*, quiet: bool, **values: Any) -> None:
        if quiet:
            set_quiet(True)
        if loads is not None:
            with working("starting"), without_collection(), quick_imports():
                import_module(loads)
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
