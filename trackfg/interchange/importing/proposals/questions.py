"""Questions about what the data of a source cannot say, and the times of its tables."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

from trackfg.errors import BadInputError
from trackfg.interchange.importing.columns.time_columns import (
    counter_of,
    refuse_displaced_times,
    stalled_times,
    stated_rate_hz,
    time_columns,
    time_unit,
)
from trackfg.interchange.importing.columns.written_units import Quantity, factor_of
from trackfg.interchange.importing.source_table import SourceTable


@dataclass(frozen=True)
class Question:
    """A question has a ``key``, a ``text``, and a ``default`` that is taken without an answer; empty: there is none.

    ``choices``: the answers that are possible, if they can be listed; ``accepts`` decides whether one is, ``expected``
    says what it looks like. One that is ``optional`` may be left without an answer.
    """

    key: str
    text: str
    default: str
    choices: tuple[str, ...] = ()
    accepts: Callable[[str], bool] = lambda _: True
    optional: bool = False
    expected: str = "an answer"


Ask = Callable[[Question], str]

_YES_OR_NO = {
    "yes": (
        "ja",
        "j",
        "oui",
        "o",
        "si",
        "sí",
        "sì",
        "s",
        "sim",
        "tak",
        "ano",
        "igen",
        "kyllä",
        "да",
        "是",
        "true",
        "1",
    ),
    "no": ("nein", "non", "nee", "nej", "nei", "não", "nie", "ne", "nem", "ei", "нет", "否", "不是", "false", "0"),
}
"""What is taken for yes and no besides their own beginnings, in the languages that channels of tables are named in."""
_GROUPED = re.compile(r"[1-9]\d{0,2}(,\d{3})+(\.\d*)?")
"""A number with commas that may stand between thousands."""


def choice_in(answer: str, choices: Sequence[str]) -> str | None:
    """Return the one choice that an answer, or its beginning, means; None where it is none or several.

    Yes and no may be answered in other languages.
    """
    word = answer.strip().casefold()
    if answer.strip() in choices:
        return answer.strip()
    translated = [choice for choice in choices if word in _YES_OR_NO.get(choice, ())]
    matches = translated or [choice for choice in choices if word and choice.casefold().startswith(word)]
    return matches[0] if len(matches) == 1 else None


def number_in(answer: str, within: tuple[float, float] = (0.0, float("inf"))) -> float | None:
    """Return the number of an answer, above zero and ``within`` two bounds; None where it is none, or may be two.

    A comma is a decimal one, or stands between thousands: ``1,435`` is what the bounds allow.
    """
    text = answer.strip()
    readings = [text.replace(",", ".")] if text.count(",") <= 1 and not ("," in text and "." in text) else []
    readings += [text.replace(",", "")] if _GROUPED.fullmatch(text) else []
    numbers = set()
    for reading in readings:
        try:
            numbers.add(float(reading))
        except ValueError:
            return None
    low, high = within
    possible = [number for number in numbers if 0.0 < number < float("inf") and low <= number <= high]
    return possible[0] if len(possible) == 1 else None


def asked(ask: Ask, question: Question) -> str:
    """Return the answer. Raises :class:`BadInputError` where there is none, or none that the question accepts."""
    answer = ask(question)
    if not answer.strip():
        raise BadInputError(
            f"{question.key}: the source does not say it ({question.text}); expected {question.expected}. Hint: answer "
            "the question of trackfg init, or state the key in a mapping (docs/importing.md)"
        )
    if not question.accepts(answer):
        raise BadInputError(f"{question.key}: {answer!r} is not understood; expected {question.expected}")
    return answer


def asked_number(
    ask: Ask, key: str, text: str, default: str, within: tuple[float, float] = (0.0, float("inf"))
) -> float:
    """Return a number above zero and ``within`` two bounds, so that an answer in another unit is asked again."""
    low, high = within
    expected = f"a number such as {default}" if default else "a number"
    if high < float("inf"):
        expected += f", up to {high:g}" if low == 0.0 else f", from {low:g} to {high:g}"

    question = Question(
        key, text, default, accepts=lambda answer: number_in(answer, within) is not None, expected=expected
    )
    number = number_in(asked(ask, question), within)
    assert number is not None
    return number


def asked_unit(ask: Ask, key: str, text: str, default: str, quantity: Quantity) -> str:
    """Return a unit of that quantity, perhaps with the number that one count stands for."""
    examples = {"angular rate": "rad/s, deg/s, 8.75 mdeg/s", "acceleration": "m/s^2, g, 0.122 mg", "speed": "m/s, km/h"}
    expected = f"a unit such as {examples.get(quantity, 'm')}"
    return asked(
        ask,
        Question(key, text, default, accepts=lambda answer: factor_of(answer, quantity) is not None, expected=expected),
    )


def sensors_in(sections: dict[str, Any]) -> list[dict[str, Any]]:
    """Return the sections of a mapping that are sensors, those in lists too: they have a ``file``."""
    parts = [part for value in sections.values() for part in (value if isinstance(value, list) else [value])]
    return [part for part in parts if isinstance(part, dict) and "file" in part]


@dataclass
class Proposal:
    """A proposed mapping: its ``sections``, and for keys (``"imu.axes"``) why they are what they are.

    ``assumed``: keys of units that the source does not state, which the data may show later, with what to ask else.
    """

    sections: dict[str, Any]
    reasons: dict[str, str] = field(default_factory=dict)
    assumed: dict[str, str] = field(default_factory=dict)
    _times: dict[str, dict[str, Any]] = field(default_factory=dict)

    def times_of(
        self, table: SourceTable, ask: Ask | None = None, beside: tuple[SourceTable, str] | None = None
    ) -> dict[str, Any]:
        """Return the keys of a table's times; of samples without any by counting them, at a rate that is asked.

        ``beside``: as in :func:`~trackfg.interchange.importing.columns.time_columns.time_unit`. Raises
        :class:`BadInputError` where there are none and ``ask`` is None.
        """
        if table.name not in self._times:
            self._times[table.name] = self._new_times(table, ask, beside)
        return dict(self._times[table.name])

    @property
    def sensors(self) -> list[dict[str, Any]]:
        """The sections of sensors, those in lists too."""
        return sensors_in(self.sections)

    def clock_of_imu(self, tables: Sequence[SourceTable]) -> tuple[SourceTable, str] | None:
        """Return the table of the inertial sensor, the gyro's of two, and its column of times if it is one."""
        file, time = self.sections["imu"]["file"], self.sections["imu"].get("time")
        name = file if isinstance(file, str) else file[0]
        table = next((table for table in tables if table.name == name), None)
        return (table, time) if table is not None and isinstance(time, str) and time in table.columns else None

    def _new_times(self, table: SourceTable, ask: Ask | None, beside: tuple[SourceTable, str] | None) -> dict[str, Any]:
        columns = time_columns(table)
        if columns is not None:
            unit = time_unit(table, columns, beside)
            if unit.get("time_unit") == "gps":
                self.reasons["imu.time_unit"] = f"{columns[0]} is named after GPS: it counts from 1980-01-06, not 1970"
            return {"time": columns[0] if len(columns) == 1 else list(columns), **unit}
        if ask is None:
            raise BadInputError(
                f"{table.name}: no column of times found among {', '.join(table.columns[:30])}; expected one. Hint: "
                "name it in a mapping (docs/importing.md)"
            )
        refuse_displaced_times(table)
        rate, stalled = stated_rate_hz(table), stalled_times(table)
        reason = (
            "has no times" if stalled is None else f"has times, {stalled[0]}, of {stalled[1]} values only in all rows"
        )
        text = f"Samples per second, since {table.name} {reason}"
        answer = asked_number(ask, "imu.rate_hz", text, "" if rate is None else f"{rate:.12g}")
        self.reasons["imu.tick_s"] = f"of {answer:.12g} samples per second"
        return {"time": counter_of(table), "time_unit": "ticks", "tick_s": 1.0 / answer}
