"""Trends as layers of their map: what a GIS draws where the track drifts, was worked on, and will reach a limit."""

from __future__ import annotations

import pandas as pd

from trackfg.mapping.changes.overlay import SUMMARY_M
from trackfg.maps.feature_map import FeatureMap
from trackfg.maps.layers import Layer, stretches
from trackfg.results.trends import TEXTS, Trends


def trend_layers(found: Trends, feature_map: FeatureMap) -> tuple[Layer, ...]:
    """Return the layers of trends, steps, limits and sections, each with a line per row along the map's track.

    Columns are those of the tables, but rates do not say what they are per: a column ``per`` does.
    """
    sections = found.sections.rename(columns={"chainage_m": "from_m"})
    sections.insert(1, "to_m", sections["from_m"] + SUMMARY_M)
    return tuple(
        stretches(name, description, _attributes(table, found.per), feature_map)
        for name, description, table in (
            ("trends", "Where the track drifts, and how fast", found.trends),
            ("trend_steps", "Where the track was worked on, or damaged", found.steps),
            ("trend_limits", "When limits will be reached", found.reached),
            ("trend_sections", "Standard deviations of every 200 m and their growth", sections),
        )
    )


def _attributes(table: pd.DataFrame, per: str) -> pd.DataFrame:
    """Return a table with columns that have the same names and types whatever was found, and whatever rates are per."""
    named = table.rename(
        columns=lambda name: name.replace(f"rate_mm_per_{per}", "rate_mm").replace(f"_mm_per_{per}", "_rate_mm")
    )
    kinds = {name: "str" if name in TEXTS else "int64" if "runs" in str(name) else "float64" for name in named}
    return named.astype(kinds).assign(per=pd.Series(per, index=named.index, dtype="str"))
