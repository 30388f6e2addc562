"""Channel files of track recording cars: one row each 0.25 m, one column a channel, as a template says.

A template is TOML: a list ``[[channel]]``, each with the ``name`` that heads its column and the ``column`` of the
geometry, with times and positions, that it shows (``running`` counts rows, ``text`` is that of the template, ``km+m``
the chainage as 12+0345.25, or the official place where such are wanted). ``factor`` converts the unit, ``offset`` is
subtracted first, ``decimals`` rounds. Channels that the run does not have, such as the rails' without lasers, are left
empty.
"""

from __future__ import annotations

from importlib import resources
from pathlib import Path
from typing import Annotated

import numpy as np
import pandas as pd
from pydantic import Field

from trackfg.errors import BadInputError
from trackfg.files.small_file import read_toml, toml_of, validated
from trackfg.numerics.arrays import Array
from trackfg.numerics.chainage.km_notation import written_places
from trackfg.recording.strict_model import Model
from trackfg.results.official_places import KM_COLUMN

BUILT_IN = "channels.toml"
"""The template that is used unless another is given."""


class Channel(Model):
    """A column of a channel file."""

    name: str
    column: str
    text: str = ""
    factor: float = 1.0
    offset: float = 0.0
    decimals: Annotated[int, Field(ge=0, le=12)] = 3


def read_template(path: Path | None) -> tuple[Channel, ...]:
    """Read a template, or the built-in one. Raises :class:`BadInputError` with file, key and what was expected."""
    name = BUILT_IN if path is None else str(path)
    built_in = resources.files("trackfg.interchange.exporting").joinpath(BUILT_IN)
    content = toml_of(built_in.read_bytes()) if path is None else read_toml(path)
    entries = content.get("channel")
    if not isinstance(entries, list) or not entries:
        raise BadInputError(f"{name}: no [[channel]]; expected at least one")
    return tuple(validated(Channel, entry, f"{name}: ", "channel, key ") for entry in entries)


def channel_table(located: pd.DataFrame, channels: tuple[Channel, ...]) -> pd.DataFrame:
    """Return the columns of a channel file from a geometry with places."""
    return pd.DataFrame({channel.name: _values(located, channel) for channel in channels})


def _values(located: pd.DataFrame, channel: Channel) -> Array | list[str]:
    if channel.column == "running":
        return np.arange(1.0, len(located) + 1.0)
    if channel.column == "text":
        return [channel.text] * len(located)
    if channel.column == "km+m" and KM_COLUMN in located:
        return located[KM_COLUMN].tolist()
    if channel.column == "km+m":
        return written_places(located["chainage_m"].to_numpy(), digits=4)
    if channel.column not in located:
        return np.full(len(located), np.nan)
    values = located[channel.column].to_numpy(dtype=np.float64)
    return np.asarray(np.round((values - channel.offset) * channel.factor, channel.decimals))
