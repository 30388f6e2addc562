from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pandas as pd
import pytest

import trackfg
from trackfg.geometry.curves import curve_sense
from trackfg.plots.curve_labels import curves, sense_and_radius
from trackfg.plots.scales import common_zero, extent, with_limits
from trackfg.plots.sheet import Panel, Sheet, limit_labels
from trackfg.plots.strip_chart import LimitLine, geometry_sheet
from trackfg.recording.line_kilometrage import KmEquation, LineKilometrage
from trackfg.results.columns import RAIL_COLUMNS
from trackfg.results.result import Result
from trackfg.results.summary import RunFacts
from trackfg.results.verdict import Verdict

Make = Callable[..., Result]

NO_CROSS_LEVEL = Verdict(quantity="cross_level", status="not_trusted", factor=None, reasons=("a",), hints=("b",))


@pytest.fixture(scope="module")
def with_rails(result: Result) -> Result:
    rows = len(result.geometry)
    rails = {name: np.full(rows, 0.1 if name.endswith("_sd") else 1.0) for name in RAIL_COLUMNS}
    rails["gauge_mm"] = np.full(rows, 1070.0)
    rails["level_left_mm"] = 9.0 * np.sin(np.arange(rows) / 10.0)
    return replace(result, geometry=result.geometry.assign(**rails))


def changed(result: Result, **columns: object) -> Result:
    return replace(result, geometry=result.geometry.assign(**columns))


def panel(sheet: Sheet, name: str) -> Panel:
    (found,) = (panel for panel in sheet.panels if panel.curves[0].name == name)
    return found


def long_result(result: Result, km: float) -> Result:
    """Noise over a long run, with one peak."""
    rng = np.random.default_rng(1)
    rows = round(4000 * km)
    table = pd.DataFrame({name: np.full(rows, 0.1) for name in (*result.geometry.columns, *RAIL_COLUMNS)})
    for name in table.columns:
        if not name.endswith("_sd"):
            table[name] = rng.normal(size=rows)
    table["chainage_m"] = 0.25 * np.arange(rows)
    table.loc[rows // 3, "twist_mm"] = 25.0
    return replace(result, geometry=table)


def test_official_places_stand_at_the_top(result: Result, tmp_path: Path) -> None:
    """At chainage 20 kilometrage jumps back by 5 m: a place is there twice."""
    equations = (KmEquation(chainage_m=0.0, km="12+000"), KmEquation(chainage_m=20.0, km="12+015"))
    run = RunFacts(
        content_sha256="0" * 64,
        direction=1,
        anchored=True,
        mount_roll_sd_rad=0.0,
        kilometrage=LineKilometrage(equation=equations),
    )
    located = replace(result, summary=result.summary.model_copy(update={"run": run}))
    sheet = geometry_sheet(located, 0.0, 40.0, ())
    top = sheet.panels[0]
    before, after = ("12+005", "12+010", "12+015 (1)"), ("12+015 (2)", "12+020 (2)", "12+025", "12+030")
    assert top.marks == tuple(zip(np.arange(5.0, 40.0, 5.0), (*before, *after), strict=True))
    assert top.y_range[1] > geometry_sheet(result, 0.0, 40.0, ()).panels[0].y_range[1]
    assert "official places" in sheet.x_label
    trackfg.plot_geometry(located, tmp_path / "chart.svg", from_m=0.0, to_m=40.0)
    assert "12+005" in (tmp_path / "chart.svg").read_text()


def test_channels_from_top_to_bottom(result: Result, with_rails: Result) -> None:
    names = [panel.curves[0].name for panel in geometry_sheet(result, None, None, ()).panels]
    common = ["cross-level", "twist", "versine level", "versine alignment", "gradient", "speed", "curvature"]
    assert names == ["level", "alignment", *common]
    rails = [panel.curves[0].name for panel in geometry_sheet(with_rails, None, None, ()).panels]
    assert rails[:5] == ["level left rail", "level right rail", "alignment left rail", "alignment right rail", "gauge"]
    assert rails[5:] == common


def test_rails_that_were_not_measured_do_not_hide_the_centre_line(with_rails: Result) -> None:
    """As a table of another system may have them; here of the level alone."""
    partly = changed(with_rails, **{name: np.nan for name in RAIL_COLUMNS if name.startswith("level")})
    names = [panel.curves[0].name for panel in geometry_sheet(partly, None, None, ()).panels]
    assert names[:4] == ["level", "alignment left rail", "alignment right rail", "gauge"]


def test_units_of_the_labels(result: Result) -> None:
    sheet = geometry_sheet(result, None, None, ())
    speed, curvature = panel(sheet, "speed"), panel(sheet, "curvature")
    assert speed.label == "speed, km/h"
    assert speed.curves[0].y.max() == pytest.approx(3.6 * 16.0, abs=0.05)
    assert speed.curves[0].half_band is None
    assert curvature.label == "curvature, 1/km"
    assert curvature.curves[0].y.max() == pytest.approx(2.0)
    assert curvature.curves[0].half_band is not None
    np.testing.assert_allclose(curvature.curves[0].half_band, 1.96 * 0.01)
    assert sheet.x_label == "chainage, m"
    assert "Twist on 5 m, versines on a chord of 10 m, level and alignment in the band 3-25 m" in sheet.footer
    assert "facing increasing chainage" in sheet.footer


def test_curve_and_its_cant_run_together_at_the_foot(result: Result) -> None:
    foot = geometry_sheet(result, None, None, ()).panels[-1]
    assert foot.over is not None
    assert foot.y_range is not None
    assert foot.over.y_range is not None
    (low, high), (bottom, top) = foot.y_range, foot.over.y_range
    assert bottom > top  # upside down: cant of a curve to the left is negative
    assert -low / (high - low) == pytest.approx(bottom / (bottom - top))
    assert [text for _, text in foot.marks] == ["left R 500 m"]
    assert foot.marks[0][0] == pytest.approx(749.0, abs=5.0)
    assert "left R 500 m" in foot.curves[0].notes
    assert "straight" in foot.curves[0].notes


def test_a_range(result: Result) -> None:
    sheet = geometry_sheet(result, 100.0, 300.5, ())
    assert sheet.x_range == (100.0, 300.5)
    assert sheet.title == "made-up   100 to 300.5 m"
    for one in sheet.panels:
        assert one.curves[0].x.tolist() == np.arange(100.0, 300.75, 0.25).tolist()


def test_long_runs_are_in_km(result: Result) -> None:
    far = changed(result, chainage_m=12_000.0 + 2.0 * result.geometry["chainage_m"])
    sheet = geometry_sheet(far, None, None, ())
    assert sheet.x_label == "chainage, km"
    assert sheet.title == "made-up   12.000 to 14.996 km"
    assert sheet.x_range == pytest.approx((12.0, 14.9965))


@pytest.mark.parametrize(("from_m", "to_m"), [(1e5, None), (None, -1.0), (100.1, 100.2)])
def test_an_empty_range(result: Result, from_m: float | None, to_m: float | None) -> None:
    with pytest.raises(trackfg.BadInputError, match=r"no geometry .* the result covers chainage 0\.00 to 1498\.25 m"):
        geometry_sheet(result, from_m, to_m, ())


def test_a_range_whose_ends_are_swapped(result: Result) -> None:
    with pytest.raises(trackfg.BadInputError, match="from 300 m to 100 m: expected the smaller chainage first"):
        geometry_sheet(result, 300.0, 100.0, ())


def test_a_gap_stays_a_gap(result: Result) -> None:
    twist = result.geometry["twist_mm"].where(~result.geometry["chainage_m"].between(400.0, 500.0))
    curve = panel(geometry_sheet(changed(result, twist_mm=twist), None, None, ()), "twist").curves[0]
    inside = (curve.x >= 400.0) & (curve.x <= 500.0)
    assert inside.any()
    assert np.isnan(curve.y[inside]).all()
    assert np.isfinite(curve.y[~inside]).all()


def test_a_channel_that_was_not_measured(result: Result) -> None:
    empty = changed(result, twist_mm=np.nan, twist_mm_sd=np.nan)
    assert "twist" not in {shown.curves[0].name for shown in geometry_sheet(empty, None, None, ()).panels}


def test_a_sigma_without_bound_does_not_squeeze_the_values(result: Result) -> None:
    slow = result.geometry["chainage_m"].between(700.0, 720.0)
    level = result.geometry["level_mm"].where(~slow, 800.0)
    sigma = result.geometry["level_mm_sd"].where(~slow, 500.0)
    shown = panel(geometry_sheet(changed(result, level_mm=level, level_mm_sd=sigma), None, None, ()), "level").y_range
    assert shown is not None
    assert shown[1] == pytest.approx(3.0 * 1.16, abs=0.01)


def test_a_quantity_that_is_not_to_be_trusted_is_so_labelled(make_result: Make) -> None:
    sheet = geometry_sheet(make_result(verdicts=[NO_CROSS_LEVEL]), None, None, ())
    labels = [panel.label for panel in sheet.panels]
    assert [label for label in labels if "trusted" in label] == ["cross-level\n(not trusted), mm"]
    assert sheet.panels[-1].over is not None
    assert sheet.panels[-1].over.label == "cross-level\n(not trusted), mm\n(right, reversed)"


def test_a_defect_that_stands_out_of_its_noise_stays_in_the_panel() -> None:
    values, sigmas = np.zeros(1000), np.full(1000, 0.1)
    values[500], sigmas[500] = 30.0, 2.0
    assert extent(values, sigmas, 0.0, 1.0) == (0.0, 30.0)


def test_a_quiet_channel_is_not_blown_up() -> None:
    assert extent(np.array([-0.01, 0.01]), np.full(2, 0.1), 0.0, 1.0) == (-1.0, 1.0)
    assert extent(np.full(10, 0.01), np.full(10, 0.1), 0.0, 1.0) == (0.0, 1.0)  # such as a speed: never below zero


def test_both_rails_have_one_scale(with_rails: Result) -> None:
    sheet = geometry_sheet(with_rails, None, None, ())
    assert panel(sheet, "level left rail").y_range == panel(sheet, "level right rail").y_range
    gauge = panel(sheet, "gauge")
    assert gauge.base == 1067.0
    assert gauge.y_range is not None
    assert gauge.y_range[0] < 1067.0 < 1070.0 < gauge.y_range[1]


def test_common_zero() -> None:
    a, b = common_zero((-1.0, 4.0), (-50.0, 100.0))
    assert a == (-2.0, 4.0)
    assert b == (-50.0, 100.0)


def test_limits_near_the_values_are_in_the_panel_others_are_named_at_its_edge(result: Result) -> None:
    ends = np.array([0.0, 1500.0])
    limits = [
        LimitLine("twist_mm", name, ends, np.full(2, value))
        for name, value in (("alert", 4.0), ("", -4.0), ("act", 40.0), ("", -40.0))
    ]
    assert with_limits(-2.0, 2.0, 0.0, np.array([4.0, 40.0, np.nan])) == (-2.0, 4.0)
    twist = panel(geometry_sheet(result, None, None, limits), "twist")
    assert twist.y_range == pytest.approx((-4.64, 4.64))
    (edge, act), (height, alert) = limit_labels(twist)
    assert (edge, act, alert) == (1.0, "act 40 ↑", "alert 4")
    assert height == pytest.approx(0.8)  # moved down from 0.93, for the other's sake


def test_limits_of_channels_that_are_not_shown_are_left_out(result: Result) -> None:
    sheet = geometry_sheet(result, None, None, [LimitLine("gauge_mm", "alert", np.zeros(1), np.ones(1))])
    assert not any(one.limits for one in sheet.panels)


def test_curves_of_a_rough_line() -> None:
    chainage = np.arange(0.0, 2000.0, 0.25)
    bend = np.interp(chainage, [200, 260, 500, 560, 900, 960, 1300, 1360], [0, 1, 1, 0, 0, -0.5, -0.5, 0]) / 300.0
    rough = bend + 3e-4 * np.sin(2.0 * np.pi * chainage / 18.0)
    (_, _, right), (start, end, left) = curves(chainage, rough)
    assert re.fullmatch(r"right R (59\d|60\d) m", right)
    assert re.fullmatch(r"left R (29\d|30\d) m", left)
    assert start == pytest.approx(203.0, abs=10.0)
    assert end == pytest.approx(557.0, abs=10.0)
    assert set(curve_sense(chainage, rough)) == {-1.0, 0.0, 1.0}


def test_sense_and_radius() -> None:
    assert [sense_and_radius(k) for k in (1 / 402, -1 / 1200, 1e-5, np.nan)] == [
        "left R 402 m",
        "right R 1200 m",
        "straight",
        "",
    ]


def test_no_peak_of_a_long_run_is_lost(result: Result) -> None:
    sheet = geometry_sheet(long_result(result, 20.0), None, None, ())
    curve = panel(sheet, "twist").curves[0]
    assert len(curve.x) < 5000
    assert curve.y.max() == 25.0
    assert curve.x[np.argmax(curve.y)] == pytest.approx(80_000 // 3 * 0.25e-3)
    assert "a shorter range shows every row" in sheet.footer


def test_svg_is_reproducible(result: Result, tmp_path: Path) -> None:
    a, b = (trackfg.plot_geometry(result, tmp_path / name) for name in ("a.svg", "b.svg"))
    assert a.read_bytes() == b.read_bytes()
    ElementTree.parse(a)


def test_png_of_a_run_whose_name_is_no_formula(make_result: Make, tmp_path: Path) -> None:
    odd = make_result(rows=100, recording_id=r"5 $\bogus$ <run>")
    assert trackfg.plot_geometry(odd, tmp_path / "a.png").read_bytes().startswith(b"\x89PNG")


def test_page_of_100_km_needs_no_network_and_stays_small(result: Result, tmp_path: Path) -> None:
    page = trackfg.plot_geometry(long_result(result, 100.0), tmp_path / "a.html").read_text(encoding="utf-8")
    assert len(page.encode()) < 8_000_000
    assert not re.search(r"<(script|link|img)[^>]+(src|href)=", page)


def test_a_folder_is_no_result() -> None:
    with pytest.raises(
        TypeError, match=r"plot_geometry takes a result, as trackfg\.Result\.read\(folder\) gives, not str"
    ):
        trackfg.plot_geometry("out1")  # type: ignore[arg-type]


def test_unknown_kind_of_file(result: Result, tmp_path: Path) -> None:
    with pytest.raises(trackfg.BadInputError, match=r"\.png, \.svg or \.html"):
        trackfg.plot_geometry(result, tmp_path / "a.pdf")
    assert list(tmp_path.iterdir()) == []
