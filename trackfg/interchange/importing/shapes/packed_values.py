"""Arrays whose attributes say what a count is worth become the values that were measured.

The conventions for climate and forecast (CF 1.11, section 8.1), which netCDF follows, pack values as ``scale_factor``
times the number plus ``add_offset``. Loggers that write HDF5 keep counts of a converter with a ``scale`` or a ``gain``
of one count, and perhaps an ``offset``.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from trackfg.interchange.importing.columns.written_units import number_and_unit

_CF = ("scale_factor", "add_offset")
_OFFSET = "offset"
_SCALES = ("scale", "scaling", "scale factor", "scaling_factor", "scalefactor", "lsb", "gain")
"""Attributes of other loggers, for whole numbers alone."""
_GAIN = "gain"
"""That of an amplifier in front of the converter is 1 or more; what a count is worth is less."""
_MISSING = ("_fillvalue", "missing_value")
_UNITS = ("units", "unit")


def unpacked(values: np.ndarray, attributes: Mapping[str, Any]) -> np.ndarray:
    """Return the values of an array, NaN where they are missing; names of ``attributes`` are in lower case."""
    missing = [np.ravel(attributes[name])[0] for name in _MISSING if name in attributes]
    is_missing = np.isin(values, missing)
    factor, offset = (_number(attributes.get(name)) for name in _CF)
    if factor is None and offset is None and (scale := scale_in(attributes, values.dtype)) is not None:
        factor, offset = _number(attributes[scale]), _number(attributes.get(_OFFSET))
    if factor is None and offset is None and not is_missing.any():
        return values
    physical = values * (1.0 if factor is None else factor) + (0.0 if offset is None else offset)
    return np.where(is_missing, np.nan, physical)


def scale_in(attributes: Mapping[str, Any], kind: np.dtype[Any]) -> str | None:
    """Return the attribute that says what a count is worth, of values of a ``kind`` that are counts; None without."""
    if kind.kind not in "iu" or any(name in attributes for name in _CF):
        return None
    scales = {name: number for name in _SCALES if (number := _number(attributes.get(name))) is not None}
    return next((name for name, number in scales.items() if name != _GAIN or 0.0 < abs(number) < 1.0), None)


def scale_of_others(attributes: Mapping[str, Any], kind: np.dtype[Any]) -> str | None:
    """Return the attribute of a scale that is not applied, since the values of this ``kind`` are no counts."""
    scales = [name for name in _SCALES if _number(attributes.get(name)) not in (None, 1.0)]
    return scales[0] if scales and kind.kind == "f" and not any(name in attributes for name in _CF) else None


def unit_in(attributes: Mapping[str, Any]) -> str | None:
    """Return the unit that attributes state: as such, or behind the number of a scale, ``0.0175 deg/s``."""
    for name in _UNITS:
        unit: Any = attributes.get(name)
        unit = np.ravel(unit)[0] if unit is not None and np.size(unit) == 1 else unit
        if isinstance(unit, str | bytes):
            return _text(unit)
    scales = (_text(attributes[name]) for name in _SCALES if isinstance(attributes.get(name), str | bytes))
    return next((parts[1] for scale in scales if (parts := number_and_unit(scale)) is not None), None)


def _number(value: Any) -> float | None:
    """Return the number that an attribute holds, which may be text with a unit behind it; None where it holds none."""
    if isinstance(value, str | bytes):
        text = _text(value)
        parts = number_and_unit(text)
        value = text if parts is None else parts[0]
    elif value is None or np.size(value) != 1 or np.asarray(value).dtype.kind not in "iuf":
        return None
    try:
        return float(np.ravel(value)[0])
    except ValueError:
        return None


def _text(value: str | bytes) -> str:
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)
