"""Tables and JSON of the commands about maps."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from rich.box import SIMPLE_HEAD
from rich.console import RenderableType
from rich.table import Column, Table
from rich.text import Text

from trackfg.cli.tables import named_values, records
from trackfg.cli.terminal import columns, titled
from trackfg.errors import printable
from trackfg.maps.feature_map import GRID_QUANTITIES, FeatureMap
from trackfg.results.official_places import KM_COLUMN, with_km

if TYPE_CHECKING:
    from trackfg.mapping.changes.changes import Changes
    from trackfg.mapping.changes.difference import Difference
    from trackfg.numerics.arrays import Array
    from trackfg.numerics.chainage.kilometrage import Kilometrage

_SCALE = {"1pm": (1e6, "1/Mm"), "permille": (1.0, "‰"), "mm": (1.0, "mm"), "m": (1.0, "m")}
"""Factor and unit in which a column is shown, by its suffix."""

MOVED_SIGMAS = 3.0
"""Quantities that moved by fewer sigmas are counted and not shown; JSON has everything."""


def of_map(
    feature_map: FeatureMap, versions: pd.DataFrame, kilometrage: Kilometrage | None = None
) -> Iterator[RenderableType]:
    """Yield tables of one version of a map: extent, sigmas, runs, landmarks; and of the versions there are.

    Landmarks have official places where a kilometrage is given.
    """
    yield _overview(feature_map)
    yield _sigmas(feature_map)
    yield _runs(feature_map)
    yield _landmarks("Landmarks", with_km(feature_map.landmarks, kilometrage))
    yield _versions(versions)


def map_json(feature_map: FeatureMap, versions: pd.DataFrame, kilometrage: Kilometrage | None = None) -> str:
    """Return the same as JSON; the grid by its stretches and sigmas."""
    content = {
        "name": feature_map.name,
        "version": feature_map.version,
        "parent": feature_map.parent,
        "written_at": feature_map.written_at,
        "origin": feature_map.origin,
        "conventions": vars(feature_map.conventions),
        "stretches_m": _stretches(feature_map),
        "cells": len(feature_map.grid),
        "observations": _fewest_and_most(feature_map),
        "sigmas": _sigma_rows(feature_map),
        "runs": records(feature_map.runs),
        "landmarks": records(with_km(feature_map.landmarks, kilometrage)),
        "versions": records(versions),
        "software": dict(feature_map.software),
    }
    return _json(content)


def of_difference(a: FeatureMap, b: FeatureMap, comparison: Difference) -> Iterator[RenderableType]:
    """Yield tables of what moved by :data:`MOVED_SIGMAS` or more, landmarks added and removed, and the grid."""
    yield named_values(
        "Difference, the second less the first",
        {
            "first": _which(a),
            "second": _which(b),
            "runs": _RELATIONS[comparison.relation],
            "landmarks": f"{len(comparison.added)} added, {len(comparison.removed)} removed",
            "cells": f"{comparison.cells_added} added, {comparison.cells_removed} removed",
        },
    )
    if len(comparison.added):
        yield _landmarks("Landmarks added", comparison.added)
    if len(comparison.removed):
        yield _landmarks("Landmarks removed", comparison.removed)
    yield _moved(comparison.moved)
    yield _sections(comparison.sections)


def difference_json(a: FeatureMap, b: FeatureMap, comparison: Difference) -> str:
    """Return all of a difference as JSON."""
    content = {
        "a": {"name": a.name, "version": a.version},
        "b": {"name": b.name, "version": b.version},
        "relation": comparison.relation,
        "moved": records(comparison.moved),
        "added": records(comparison.added),
        "removed": records(comparison.removed),
        "sections": records(comparison.sections),
        "cells_added": comparison.cells_added,
        "cells_removed": comparison.cells_removed,
    }
    return _json(content)


def of_changes(changes: Changes) -> Iterator[RenderableType]:
    """Yield tables of what changed, and of what would have been found."""
    if len(changes.table):
        km = KM_COLUMN in changes.table
        places = _numbers(*(["km"] if km else []), "from m", "to m")
        values = _numbers("before", "after", "change", "sigmas")
        kind = columns("kind", no_wrap=True)
        table = _compact("Changes, the run less the map", *places, *kind, "quantity", *values)
        for row in _rows(changes.table):
            scale, unit = _shown_in(row.quantity)
            table.add_row(
                *([row.km] if km else []),
                f"{row.from_m:.2f}",
                f"{row.to_m:.2f}",
                row.kind,
                _label(row.quantity, unit),
                f"{scale * row.before:.2f}",
                f"{scale * row.after:.2f}",
                _with_sd(scale * row.change, scale * row.change_sd, 2),
                f"{row.sigmas:.1f}",
            )
        yield table
    elif changes.other_track:
        yield Text("No comparison: the track is not, or no longer, the one that the map has.")
    else:
        yield Text("No change: the track is as the map has it.")
    headings = ("compared,\nm", "noise,\ntimes stated", "threshold,\nsigmas", "least change:\nmedian", "\nlargest")
    table = _compact("What would have been found", "quantity", *_numbers(*headings))
    for row in _rows(changes.thresholds):
        scale, unit = _shown_in(row.quantity)
        least = changes.coverage[row.quantity].dropna()
        texts = (f"{scale * x:.2f}" for x in (least.median(), least.max())) if len(least) else ("", "")
        table.add_row(
            _label(row.quantity, unit),
            f"{row.compared_m:.0f}",
            f"{row.noise_factor:.2f}",
            f"{row.sigmas:.1f}",
            *texts,
        )
    yield table


def changes_json(changes: Changes) -> str:
    """Return changes, thresholds and coverage as JSON."""
    content = {name: records(getattr(changes, name)) for name in ("table", "thresholds", "coverage")}
    return json.dumps({"changes": content.pop("table"), **content, "other_track": changes.other_track}, indent=2)


_RELATIONS = {
    "extended": "the second has all of the first's, and more",
    "reduced": "the first has all of the second's, and more",
    "disjoint": "none in common",
    "overlapping": "some in common: the sigmas are an upper bound",
    "same": "the same: the sigmas are a yardstick, no test",
}


def _overview(feature_map: FeatureMap) -> RenderableType:
    meaning, fewest, most = feature_map.conventions, *_fewest_and_most(feature_map)
    stretches = _stretches(feature_map)
    rows = {
        "map": _which(feature_map),
        "written": printable(feature_map.written_at or ""),
        "covers": ", ".join(f"{first:.2f} to {last:.2f} m" for first, last in stretches) or "nothing",
        "length": f"{sum(last - first for first, last in stretches) / 1e3:.3f} km, {len(feature_map.grid)} cells",
        "runs": f"{len(feature_map.runs)}; {fewest} to {most} in a cell",
        "landmarks": str(len(feature_map.landmarks)),
        "origin": "not georeferenced"
        if feature_map.origin is None
        else "{:.6f}°, {:.6f}°, {:.1f} m".format(*feature_map.origin),
        "gauge": f"{meaning.gauge_m:g} m, cross-level over {meaning.cross_level_base_m:g} m",
        "bases": f"curvature {meaning.curvature_base_m:g} m, gradient {meaning.gradient_base_m:g} m, "
        f"versines {meaning.chord_m:g} m",
        "software": printable(", ".join(f"{package} {version}" for package, version in feature_map.software.items())),
    }
    return named_values("Map", rows)


def _which(feature_map: FeatureMap) -> str:
    return printable(f"{feature_map.name}, version {feature_map.version}")


def _stretches(feature_map: FeatureMap) -> list[tuple[float, float]]:
    """Return the first and last place of each stretch without a hole."""
    x, step = feature_map.grid["chainage_m"].to_numpy(), feature_map.conventions.step_m
    breaks = np.flatnonzero(np.diff(x) > 1.5 * step)
    firsts, lasts = np.r_[0, breaks + 1], np.r_[breaks, len(x) - 1]
    return [(float(x[i]), float(x[j])) for i, j in zip(firsts, lasts, strict=True)] if len(x) else []


def _fewest_and_most(feature_map: FeatureMap) -> tuple[int, int]:
    observations = feature_map.grid["observations"]
    return (int(observations.min()), int(observations.max())) if len(observations) else (0, 0)


def _sigma_rows(feature_map: FeatureMap) -> list[dict[str, Any]]:
    rows = [("chainage of landmarks", "chainage_m", feature_map.landmarks["chainage_m_sd"])]
    rows += [(f"{name} of the grid", name, feature_map.grid[f"{name}_sd"]) for name in ("chainage_m", *GRID_QUANTITIES)]
    return [
        {"what": what, "quantity": name, "median": float(sd.median()), "most_below": float(sd.quantile(0.95))}
        for what, name, sd in rows
        if sd.notna().any()
    ]


def _sigmas(feature_map: FeatureMap) -> RenderableType:
    table = _compact("Sigmas", "", *columns("median", "95 % are below", justify="right"))
    for row in _sigma_rows(feature_map):
        scale, unit = _shown_in(row["quantity"])
        what = row["what"].replace(row["quantity"], _label(row["quantity"], ""))
        table.add_row(f"{what}, {unit}", f"{scale * row['median']:.3g}", f"{scale * row['most_below']:.3g}")
    return table


def _runs(feature_map: FeatureMap) -> RenderableType:
    estimates = _numbers("offset, m", "scale - 1,\nppm", "cross-level\nbias, mm")
    table = _compact("Runs", *columns("run", overflow="fold"), "way", *estimates)
    for row in _rows(feature_map.runs):
        recording = row.recording_id if row.recording_id != row.run_id else ""
        table.add_row(
            Text("\n".join(printable(text) for text in (row.run_id, recording, row.start) if text)),
            "up" if row.direction > 0 else "down",
            _with_sd(row.offset_m, row.offset_m_sd, 2),
            _with_sd(1e6 * (row.scale - 1.0), 1e6 * row.scale_sd, 0),
            _with_sd(row.cross_level_bias_mm, row.cross_level_bias_mm_sd, 3),
        )
    return table


def _landmarks(title: str, landmarks: pd.DataFrame) -> RenderableType:
    km = KM_COLUMN in landmarks
    name, law = columns("landmark,\nleft, right", overflow="fold"), columns("law", no_wrap=True)
    values = _numbers(*(["km"] if km else []), "chainage, m", "radius, m", "cant, mm", "transition,\nm")
    table = _compact(title, *name, *values, *law, *_numbers("runs"))
    for row in _rows(landmarks):
        kind = "" if row.landmark_id.endswith(row.kind) else row.kind
        table.add_row(
            _text(" ".join(filter(None, (row.landmark_id, kind, row.name, row.sense[:1].upper())))),
            *([row.km] if km else []),
            _with_sd(row.chainage_m, row.chainage_m_sd, 2),
            _with_sd(row.radius_m, row.radius_m_sd, 1),
            _with_sd(row.cant_mm, row.cant_mm_sd, 1),
            _with_sd(row.transition_length_m, row.transition_length_m_sd, 1),
            _text(row.law),
            str(row.observations),
        )
    return table


def _compact(title: str, *headings: str | Column) -> Table:
    """Return an empty table with one space between its columns: seven columns of numbers fit into 80 characters."""
    return titled(title, *headings, box=SIMPLE_HEAD, show_edge=False, padding=0)


def _numbers(*headings: str) -> list[Column]:
    return columns(*headings, justify="right", no_wrap=True)


def _versions(versions: pd.DataFrame) -> RenderableType:
    table = _compact("Versions", "version", "made from", "written", "runs", "trackfg")
    for row in _rows(versions):
        parent = "" if pd.isna(row.parent) else str(row.parent)
        table.add_row(str(row.version), parent, _text(row.written_at), str(row.runs), _text(row.trackfg))
    return table


def _moved(moved: pd.DataFrame) -> RenderableType:
    shown = moved[moved["sigmas"] >= MOVED_SIGMAS]
    unknown = int((moved["sigmas"].isna()).sum())
    text = f"{len(shown)} of {len(moved)} quantities of landmarks moved by {MOVED_SIGMAS:g} sigmas or more"
    if unknown:
        text += f"; of {unknown} the sigma is not known"
    if not len(shown):
        return Text(text)
    what = columns("id", "kind", "quantity", overflow="fold")
    table = _compact(text, *what, *_numbers("first", "second", "difference", "sigmas"))
    for row in _rows(shown):
        _, unit = _shown_in(row.quantity)
        table.add_row(
            _text(row.landmark_id),
            _text(row.kind),
            _label(row.quantity, unit),
            f"{row.a:.2f}",
            f"{row.b:.2f}",
            _with_sd(row.difference, row.difference_sd, 2),
            f"{row.sigmas:.1f}",
        )
    return table


def _sections(sections: pd.DataFrame) -> RenderableType:
    """Return a table with one row per quantity: over all, and where it differs most."""
    headings = ("cells", "mean", "rms", "rms,\nsigmas", "largest", "at m")
    table = _compact("Grid", "quantity", *_numbers(*headings))
    for quantity, rows in sections.groupby("quantity", sort=False):
        scale, unit = _shown_in(str(quantity))
        cells = rows["cells"].to_numpy()
        worst = rows.iloc[int(np.argmax(rows["largest"].abs()))]
        mean = np.average(rows["mean"], weights=cells)
        table.add_row(
            _label(str(quantity), unit),
            str(cells.sum()),
            f"{scale * mean:+.3g}",
            f"{scale * _rms(rows['rms'].to_numpy(), cells):.3g}",
            _with_sd(_rms(rows["rms_sigmas"].to_numpy(), cells), np.nan, 2),
            f"{scale * worst['largest']:+.3g}",
            f"{worst['largest_at_m']:.2f}",
        )
    return table


def _rms(values: Array, weights: Array) -> float:
    return float(np.sqrt(np.average(values**2, weights=weights)))


def _shown_in(quantity: str) -> tuple[float, str]:
    return _SCALE[quantity.rpartition("_")[2]]


def _label(quantity: str, unit: str) -> str:
    words = quantity.rpartition("_")[0].replace("_", " ").replace("cross level", "cross-level")
    words = words.replace("versine level", "versine of level").replace("versine alignment", "versine of alignment")
    return f"{words}, {unit}" if unit else words


def _with_sd(value: float, sd: float, digits: int) -> str:
    """Return both with so many digits after the point; nothing of what is not known."""
    if not np.isfinite(value):
        return ""
    return f"{value:.{digits}f}" + (f" ± {sd:.{digits}f}" if np.isfinite(sd) else "")


def _text(text: str) -> Text:
    """Return a text of a map without markup and control characters."""
    return Text(printable(text))


def _json(content: dict[str, Any]) -> str:
    """Return JSON whose characters a terminal can show; others are escaped."""
    lines = json.dumps(content, indent=2, ensure_ascii=False).split("\n")
    return "\n".join("".join(c if c.isprintable() else json.dumps(c)[1:-1] for c in line) for line in lines)


def _rows(table: pd.DataFrame) -> Iterator[Any]:
    """Yield a named tuple per row; pandas does not give the types of its fields."""
    yield from table.itertuples(index=False)
