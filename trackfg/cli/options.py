"""A command whose options are one object."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from functools import wraps
from typing import TypeVar

T = TypeVar("T")


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
