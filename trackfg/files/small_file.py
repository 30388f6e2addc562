"""Small files are read whole: regular files only, up to a size, and TOML and JSON of no absurd depth."""

from __future__ import annotations

import errno
import json
import os
import re
import stat
import tomllib
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, TypeVar, get_args

from pydantic import BaseModel, GetCoreSchemaHandler, ValidationError, ValidatorFunctionWrapHandler
from pydantic_core import CoreSchema, ErrorDetails, core_schema

from trackfg.errors import BadInputError, expected_one_of, first_line

Content = TypeVar("Content", bound=BaseModel)

MOST_TOML_BYTES = 1_048_576
"""Size of a TOML file, bytes: a description with a hundred sensors has 50 kB, and tomllib needs 2 s for this much."""
_MOST_DOTS = 30
"""Dots of one key: tomllib takes time and memory with the square of them. Nothing here is nested deeper than 3."""
_BETWEEN_KEYS = re.compile(r"[,=\[\]{}#\n]")

_TO_READ = os.O_RDONLY | sum(getattr(os, name, 0) for name in ("O_NONBLOCK", "O_CLOEXEC", "O_BINARY"))
"""How a file is opened; no platform has all of these."""


def read_small(path: str | os.PathLike[str], most_bytes: int, *, folder: int | None = None) -> bytes:
    """Return the content of a regular file; ``folder`` is the open folder that a relative ``path`` is in.

    Raises ``OSError`` where it cannot be read, is larger than ``most_bytes``, or is a folder, a pipe or a device, which
    are not waited for.
    """
    descriptor = os.open(path, _TO_READ, dir_fd=folder)
    with open(descriptor, "rb") as file:
        status = os.fstat(descriptor)
        if not stat.S_ISREG(status.st_mode):
            raise OSError(errno.EINVAL, "is no regular file", os.fspath(path))
        if status.st_size > most_bytes:
            raise OSError(errno.EFBIG, f"is larger than {most_bytes / 2**20:g} MiB", os.fspath(path))
        return file.read(status.st_size)


def toml_of(content: bytes) -> dict[str, Any]:
    """Return the content of a TOML file, with or without a byte order mark. Raises ``ValueError`` for others."""
    text = content.decode("utf-8-sig")
    if any(part.count(".") > _MOST_DOTS for part in _BETWEEN_KEYS.split(text)):
        raise ValueError(f"a key with more than {_MOST_DOTS} dots")
    try:
        return tomllib.loads(text)
    except RecursionError:
        raise ValueError("nested too deeply") from None


def json_of(content: bytes | str) -> Any:
    """Return the content of a text of JSON. Raises ``ValueError`` for others."""
    try:
        return json.loads(content)
    except RecursionError:
        raise ValueError("nested too deeply") from None


def read_toml(path: Path) -> dict[str, Any]:
    """Return the content of a small TOML file. Raises :class:`BadInputError` that names the file."""
    try:
        return toml_of(read_small(path, MOST_TOML_BYTES))
    except OSError as error:
        raise BadInputError(f"{path}: cannot be read: {error.strerror}") from error
    except ValueError as error:  # undecodable bytes and TOML syntax alike
        raise BadInputError(f"{path}: not valid TOML in UTF-8: {first_line(error)}") from error


_SHOULD_BE = "Input should be "
"""How pydantic begins what it expected."""
_MOST_FAULTS = 5
"""More are those of another kind of file."""


def read_model(path: Path, model: type[Content]) -> Content:
    """Return the content of a small TOML file as ``model`` has it.

    Raises :class:`BadInputError` that names the file, every key at fault, and what was expected.
    """
    return validated(model, read_toml(path), f"{path}: ")


def validated(model: type[Content], content: Any, place: str, key: str = "") -> Content:
    """Return a content as ``model`` has it.

    Raises :class:`BadInputError` that begins with ``place`` and names every key at fault, or the first of many, after
    the word ``key``, what it is and what was expected of it.
    """
    try:
        return model.model_validate(content)
    except ValidationError as error:
        raise BadInputError(place + _faults(error.errors(), model, key)) from error
    except InvalidModelError as error:
        raise BadInputError(place + _faults(error.details, model, key)) from error


class InvalidModelError(BadInputError):
    """Values that a :class:`WholeModel` refuses. ``details``: each fault as pydantic has it."""

    def __init__(self, message: str, details: Sequence[ErrorDetails] = ()) -> None:
        super().__init__(message)
        self.details = details


class WholeModel(BaseModel):
    """The model of a whole file, which users make in Python too: they get one message instead of pydantic's report."""

    @classmethod
    def __get_pydantic_core_schema__(cls, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        """Return the schema inside a function that translates its errors, those of the model's own validators too."""

        def refuse_in_words(content: Any, validate: ValidatorFunctionWrapHandler) -> Any:
            try:
                return validate(content)
            except ValidationError as error:
                details = error.errors()
                raise InvalidModelError(f"{source.__name__}: {_faults(details, source)}", details) from None

        return core_schema.no_info_wrap_validator_function(refuse_in_words, handler(source))


def _faults(details: Sequence[ErrorDetails], model: type[BaseModel], key: str = "") -> str:
    """Return the keys at fault, the first of many, and what is wrong with each."""
    faults = [key + _fault(detail, model) for detail in details]
    more = [f"{len(faults) - _MOST_FAULTS} more"] if len(faults) > _MOST_FAULTS else []
    return "; ".join([*faults[:_MOST_FAULTS], *more])


def _fault(detail: ErrorDetails, model: type[BaseModel]) -> str:
    """Return a key and what is wrong with it."""
    place = [str(step) for step in detail["loc"]]
    message = detail["msg"].removeprefix("Value error, ")
    if message.startswith(_SHOULD_BE):
        section = detail["type"] in ("model_type", "model_attributes_type")
        expected = "a section with keys" if section else message.removeprefix(_SHOULD_BE)
        message = f"is {ascii(detail['input'])[:60]}; expected {expected}"
    elif detail["type"] == "missing":
        message = "is missing"
    elif detail["type"] == "extra_forbidden":
        keys = keys_at(model, place[:-1])
        message = f"unknown key; {expected_one_of(keys, place[-1])}"
    return f"{'.'.join(place)}: {message}" if place else message


def keys_at(model: type[BaseModel], place: Iterable[str]) -> list[str]:
    """Return the keys of a model, or of the part of it that ``place``, keys and positions in lists, leads to."""
    for step in place:
        annotation = model.model_fields[step].annotation if step in model.model_fields else None
        annotation = next(iter(get_args(annotation)), annotation)  # of a list, what it holds
        if isinstance(annotation, type) and issubclass(annotation, BaseModel):
            model = annotation
    return list(model.model_fields)
