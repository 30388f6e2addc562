from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pandas as pd
import pytest

import trackfg
from trackfg.plots.decimation import extremes
from trackfg.plots.sheet import BAND
from trackfg.plots.trajectory_chart import plot_trajectory, sheet_of
from trackfg.results.result import Result

Make = Callable[..., Result]
SPANS = ((20.0, 30.0), (60.0, 70.0))


@pytest.fixture(scope="module")
def reference(result: Result) -> pd.DataFrame:
    shift = pd.Series({"t_s": 0.0, "east_m": 3.0, "north_m": 4.0})
    return result.trajectory[["t_s", "east_m", "north_m"]].iloc[::10] + shift


def test_extremes_keep_every_peak_and_both_ends() -> None:
    rng = np.random.default_rng(0)
    values = rng.normal(size=100_003)
    values[77_777], values[5] = 50.0, -50.0
    keep = extremes(values, 400)
    assert {0, 5, 77_777, 100_002} <= set(keep)
    assert len(keep) <= 802
    assert (np.diff(keep) > 0).all()


def test_extremes_of_short_ones_are_all() -> None:
    assert extremes(np.array([3.0, 1.0, 2.0]), 400).tolist() == [0, 1, 2]


def test_extremes_close_no_gap_and_open_none() -> None:
    values = np.sin(np.arange(100_000) / 500.0)
    gaps = [(10, 11), (40_000, 55_000), (70_100, 70_120), (70_130, 70_140), (99_990, 100_000)]
    for start, end in gaps:
        values[start:end] = np.nan
    keep = extremes(values, 400)
    shown = values[keep]
    for start, end in gaps[:2]:  # alone in their stretches
        between = shown[(keep >= start) & (keep < end)]
        assert len(between) > 0
        assert np.isnan(between).all()
        assert {start - 1, end} <= set(keep)
    joined = ~np.isnan(shown[1:]) & ~np.isnan(shown[:-1])
    for before, after in zip(keep[:-1][joined], keep[1:][joined], strict=True):
        assert after - before <= 500
    assert len(keep) <= 6 * 400 + 2
    assert np.nanmax(shown) == np.nanmax(values)


def test_extremes_of_nothing_but_nan() -> None:
    assert extremes(np.full(5000, np.nan), 400)[[0, -1]].tolist() == [0, 4999]


def test_sheet_in_the_units_of_its_labels(result: Result, reference: pd.DataFrame) -> None:
    sheet = sheet_of(result, reference, "title", SPANS)
    speed, attitude, position = sheet.panels
    assert speed.label == "speed, km/h"
    assert speed.curves[0].y.max() == pytest.approx(3.6 * 16.0, abs=0.01)
    assert attitude.curves[0].half_band is not None
    np.testing.assert_allclose(attitude.curves[0].half_band, BAND * np.degrees(0.1))
    np.testing.assert_allclose(position.curves[2].y, 5.0)  # 3 m east, 4 m north


def test_the_map_shows_the_reference_where_it_was_withheld(result: Result, reference: pd.DataFrame) -> None:
    paths = sheet_of(result, reference, "", SPANS).paths
    assert [path.name for path in paths] == ["trajectory", "positions withheld", "positions withheld", "reference"]
    assert len(paths[-1].east_m) == 20


def test_png(result: Result, reference: pd.DataFrame, tmp_path: Path) -> None:
    path = plot_trajectory(result, tmp_path / "a.png", reference=reference, highlight=SPANS)
    assert path.read_bytes().startswith(b"\x89PNG")


def test_svg_is_reproducible(result: Result, tmp_path: Path) -> None:
    a, b = (plot_trajectory(result, tmp_path / name, title="A <run> & more") for name in ("a.svg", "b.svg"))
    assert a.read_bytes() == b.read_bytes()
    ElementTree.parse(a)


def test_page_needs_no_network_and_stays_small(make_result: Make, tmp_path: Path) -> None:
    long = make_result(rows=36_000 * 4)
    reference = long.trajectory[["t_s", "east_m", "north_m"]].iloc[::10]
    page = plot_trajectory(long, tmp_path / "a.html", reference=reference, title="A <run>", highlight=SPANS).read_text()
    assert len(page.encode()) < 5_000_000
    assert not re.search(r"<(script|link|img)[^>]+(src|href)=", page)


def test_a_folder_is_no_result() -> None:
    with pytest.raises(
        TypeError, match=r"plot_trajectory takes a result, as trackfg\.Result\.read\(folder\) gives, not str"
    ):
        plot_trajectory("out1")  # type: ignore[arg-type]


def test_unknown_kind_of_file(result: Result, tmp_path: Path) -> None:
    with pytest.raises(trackfg.BadInputError, match=r"\.png, \.svg or \.html"):
        plot_trajectory(result, tmp_path / "a.pdf")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("plot", [trackfg.plot_trajectory, trackfg.plot_geometry])
def test_without_a_path_there_is_a_figure_for_a_notebook(plot: Callable[..., Any], result: Result) -> None:
    figure = plot(result)
    assert "<div" in figure.to_html(full_html=False, include_plotlyjs=False)
    assert len(figure.data) > 3
    assert figure.layout.height >= 480


def test_a_notebook_s_figure_has_room_for_labels_and_legends(result: Result) -> None:
    layout = trackfg.plot_trajectory(result).layout
    inner = layout.height - layout.margin.t - layout.margin.b
    for axis in (layout.yaxis, layout.yaxis2, layout.yaxis3):
        assert inner * (axis.domain[1] - axis.domain[0]) > 8 * len(axis.title.text)  # at most 8 px a letter
    assert layout.legend2.bgcolor == "rgba(0,0,0,0)"  # it hides no curve of the panel above
