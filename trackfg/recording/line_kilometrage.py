"""The official kilometrage of a line as it is written in line files, recordings and results (docs/kilometrage.md)."""

from __future__ import annotations

import itertools
import math
from typing import Annotated, Literal

from pydantic import AfterValidator, BeforeValidator, Field, model_validator

from trackfg.numerics.chainage.kilometrage import Kilometrage, KmPost, Stretch, between_posts, rescaled
from trackfg.numerics.chainage.km_notation import KmNotation, metres_of
from trackfg.recording.strict_model import Model

Direction = Literal["ascending", "descending"]
LineChainage = Annotated[float, Field(strict=True, ge=-1e7, le=1e7)]
"""m: longer than any railway."""
LineId = Annotated[str, Field(pattern=r"^[^\x00]*$", max_length=1000)]
_MOST = 100_000
"""Entries of a kind: posts each 100 m of the longest railway."""


def _text(value: object) -> object:
    return repr(value) if isinstance(value, int | float) and not isinstance(value, bool) else value


def _place(value: str) -> str:
    if metres_of(value, "km") is None:
        raise ValueError(f"is {value!r}: expected a place such as 12+345 or 12.345")
    return value


KmText = Annotated[str, BeforeValidator(_text), AfterValidator(_place)]
"""A place as text, ``12+345``, or as a number of kilometres."""


class PlacedKm(Model):
    """An official place and the chainage where it is."""

    chainage_m: LineChainage
    km: KmText

    @property
    def official_m(self) -> float:
        """The official place, m."""
        return metres_of(self.km, "km") or 0.0


class KmEquation(PlacedKm):
    """A station equation: from ``chainage_m`` on, kilometrage counts from ``km``, up or down."""

    direction: Direction | None = None


class KmScale(Model):
    """Kilometrage has ``scale`` metres to one of chainage from ``chainage_m`` on, to the next of these."""

    chainage_m: LineChainage
    scale: Annotated[float, Field(strict=True, ge=0.1, le=10)]


class LineKilometrage(Model):
    """The line and its track, and how chainage becomes official places.

    Kilometrage counts from equations or between posts; without either it is the chainage. It runs to
    ``end_chainage_m``, by default for ever.
    """

    line: LineId = ""
    track: LineId = ""
    direction: Direction = "ascending"
    notation: KmNotation = "km+m"
    end_chainage_m: LineChainage | None = None
    equation: Annotated[tuple[KmEquation, ...], Field(max_length=_MOST)] = ()
    post: Annotated[tuple[PlacedKm, ...], Field(max_length=_MOST)] = ()
    scale: Annotated[tuple[KmScale, ...], Field(max_length=_MOST)] = ()

    @model_validator(mode="after")
    def _is_a_kilometrage(self) -> LineKilometrage:
        if self.equation and self.post:
            raise ValueError("equation and post are both there: expected equations or posts to count from")
        for name in ("equation", "post", "scale"):
            places = [entry.chainage_m for entry in getattr(self, name)]
            for number, (earlier, later) in enumerate(itertools.pairwise(places), start=2):
                if later <= earlier:
                    raise ValueError(f"{name} {number}: chainage_m is {later:g}: expected more than {earlier:g}")
        self.kilometrage()
        return self

    def kilometrage(self) -> Kilometrage:
        """Return the mathematics of it. Raises ``ValueError`` with what was expected."""
        ascending = self.direction == "ascending"
        if self.post:
            posts = [KmPost(post.chainage_m, post.official_m) for post in self.post]
            stretches = between_posts(posts, ascending=ascending)
        elif self.equation:
            stretches = tuple(
                Stretch(entry.chainage_m, entry.chainage_m, entry.official_m, _sign(entry.direction or self.direction))
                for entry in self.equation
            )
        else:
            stretches = (Stretch(-math.inf, 0.0, 0.0, _sign(self.direction)),)
        if self.scale:
            stretches = rescaled(stretches, [(entry.chainage_m, entry.scale) for entry in self.scale])
        return Kilometrage(stretches, math.inf if self.end_chainage_m is None else self.end_chainage_m, self.notation)

    @property
    def name(self) -> str:
        """The line and the track in words, empty where neither has an id."""
        parts = (f"line {self.line}" if self.line else "", f"track {self.track}" if self.track else "")
        return ", ".join(filter(None, parts))


def _sign(direction: Direction) -> float:
    return 1.0 if direction == "ascending" else -1.0
