"""Errors become one line on standard error and an exit status, whatever the command and the state of the streams."""

from __future__ import annotations

import _thread
import io
import os
import sys
import threading
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TextIO

from trackfg.cli.freed_memory import keep_freed_memory, leave_the_rest
from trackfg.cli.terminal import complain
from trackfg.errors import BadInputError, TrackfgError, first_line, printable

_INTERRUPTED = 130
"""Exit status after Ctrl-C, as shells count it: 128 and the number of the signal."""


@contextmanager
def exit_statuses() -> Iterator[None]:
    """Run the command line within; errors that the user can act on become one line on standard error."""
    keep_freed_memory()
    _open_closed_streams()
    _replace_what_an_encoding_lacks()
    sys.unraisablehook = _interrupt_again
    warnings.filterwarnings("ignore", category=RuntimeWarning)  # numpy's, of numbers: those of a result are checked
    try:
        try:
            yield
        except Exception as error:
            if _is_interrupted(error):
                raise SystemExit(_INTERRUPTED) from error
            raise
        finally:
            _flush_output()
            leave_the_rest()
    except BadInputError as error:
        _fail(error, status=2)
    except TrackfgError as error:
        _fail(error, status=1)
    except OSError as error:
        _fail(sentence_of(error), status=1)
    except MemoryError as error:
        _fail(f"out of memory ({first_line(error)}). Hint: {_LESS_MEMORY}", status=1)
    except RuntimeError as error:
        if str(error) != _NO_THREAD:
            raise
        _fail(f"out of memory or of processes ({_NO_THREAD}). Hint: {_LESS_MEMORY}", status=1)
    except ImportError as error:
        if isinstance(error, ModuleNotFoundError) and error.name not in sys.stdlib_module_names:
            raise
        hint = "Hint: allow more open files, or free memory"
        _fail(f"{first_line(error)}: a part of Python or of a library cannot be opened. {hint}", status=1)


def _interrupt_again(ignored: sys.UnraisableHookArgs) -> None:
    """Raise Ctrl-C anew where it came within a finaliser or a callback of the garbage collector: Python ignores what
    these raise, and the command would go on. A thread does it, after the finaliser has returned.
    """
    if issubclass(ignored.exc_type, KeyboardInterrupt):
        threading.Timer(0.05, _thread.interrupt_main).start()
    else:
        sys.__unraisablehook__(ignored)


def _is_interrupted(error: BaseException) -> bool:
    """Return whether Ctrl-C is behind the error: compiled libraries turn it into a failure of their import."""
    origin = error.__cause__ or error.__context__
    return isinstance(error, KeyboardInterrupt) or (origin is not None and _is_interrupted(origin))


_NO_THREAD = "can't start new thread"
"""What Python says where the system gives a thread no stack."""
_LESS_MEMORY = "free memory, or cut the recording into parts (docs/performance.md says what a run takes)"


def _open_closed_streams() -> None:
    """Give standard streams that were closed by the caller (``2>&-``) a place where nothing is kept."""
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, mode))  # noqa: SIM115  (for as long as the process runs)


def _replace_what_an_encoding_lacks() -> None:
    """Write ``?`` for letters that the encoding of standard output lacks, such as the root sign in ISO 8859-1."""
    if isinstance(sys.stdout, io.TextIOWrapper) and sys.stdout.errors == "strict":
        sys.stdout.reconfigure(errors="replace")


def _flush_output() -> None:
    """Write what standard streams still hold; where it cannot be written (a full disk), nothing is left to be tried."""
    for output in (sys.stdout, sys.stderr):
        try:
            output.flush()
        except OSError:
            _discard(output)
            raise


def _discard(stream: TextIO) -> None:
    """Let go of what a stream holds, which Python would try to write at the end, and exit with a status of its own."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


def sentence_of(error: OSError) -> str:
    """Return the file and why the system refused it."""
    if error.strerror is None:
        return str(error)
    return error.strerror if error.filename is None else f"{os.fsdecode(error.filename)}: {error.strerror}"


def _fail(error: Exception | str, status: int) -> None:
    try:
        complain(f"trackfg: {printable(str(error))}")
    except OSError:
        _discard(sys.stderr)
    raise SystemExit(status)
