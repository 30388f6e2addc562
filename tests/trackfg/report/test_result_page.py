from __future__ import annotations

import re
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import trackfg
from trackfg.datasets.scenarios import simulate
from trackfg.geometry.limits import Limit, LimitChoice
from trackfg.report import write_report
from trackfg.report.charts import Strips
from trackfg.report.consistency import coverage_table, error_table, histograms, named, noise_bars
from trackfg.report.geometry_charts import geometry_strips
from trackfg.report.motion_charts import motion_strips
from trackfg.report.result_page import result_page
from trackfg.report.sections.quality import bar_places
from trackfg.report.sections.summary import measured_table
from trackfg.report.track_limits import judge
from trackfg.report.track_statistics import track_statistics
from trackfg.report.truth import Against, against
from trackfg.results.columns import RAIL_COLUMNS
from trackfg.results.result import Result
from trackfg.results.verdict import Quantity, Verdict

Make = Callable[..., Result]


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> tuple[Result, Path]:
    """A smoothed run and the recording that it was made from, with its truth."""
    folder = tmp_path_factory.mktemp("run")
    simulate("mainline", seed=1, duration_s=80.0).write(folder / "rec")
    return trackfg.smooth(trackfg.read_recording(folder / "rec")), folder / "rec"


@pytest.fixture(scope="module")
def known(run: tuple[Result, Path]) -> Against:
    truth = against(*run)
    assert truth is not None
    return truth


def not_trusted(quantity: Quantity) -> Verdict:
    return Verdict(quantity=quantity, status="not_trusted", factor=None, reasons=("seen",), hints=("do",))


def text_of(result: Result, truth: Against | None = None) -> str:
    """The page without its scripts and tags."""
    html = result_page(result, "trackfg report out1 -o a.html", truth).html()
    return re.sub(r"<[^>]*>", " ", re.sub(r"<(script|style).*?</\1>", "", html, flags=re.DOTALL))


def test_places_of_a_run_without_a_fix_count_from_the_true_start(run: tuple[Result, Path], known: Against) -> None:
    """The run begins at 50 m, of which nothing measured says a word."""
    errors = known.trajectory_errors
    assert errors["along_track_m"].iloc[0] == 0.0
    assert errors["along_track_m"].abs().max() < 4.0 * errors["along_track_m_sd"].max()
    assert "Places count from the true start: no fix said where it is." in text_of(run[0], known)


def test_what_stands_in_it(result: Result) -> None:
    text = text_of(result)
    for expected in (
        "made-up",
        "1.498 km",
        "1.00210 ± 0.00030",
        "The solver converged in 4 iterations.",
        "step below tolerance",
        "101.5 at 200 degrees of freedom",
        "20.63 ± 0.21, -41.25 ± 0.21, 6.19 ± 0.41 deg/h",
        "10.0 ± 1.0, 20.0 ± 1.0, -30.0 ± 1.0 mm/s²",
        "solve 1.25 s",
        "a gap of 2 s",
        "imu.csv, column &#39;t&#39;, data row 3",
        "wheel, driven axle",
        "88.25 ± 0.30",
        "1.50 ± 0.20",
        "trackfg report out1 -o a.html",
        "gtsam",
        "rate_hz",
    ):
        assert expected in text, expected


def test_sections(result: Result, run: tuple[Result, Path], known: Against) -> None:
    sections = [section.name for section in result_page(result, "", None).sections]
    assert sections == [
        *("summary", "quality", "curves", "geometry"),
        *("findings", "events", "motion", "consistency", "map", "made"),
    ]
    assert "errors" in [section.name for section in result_page(run[0], "", known).sections]


def test_a_known_line_has_a_section(make_result: Make) -> None:
    stretch = {
        **{"status": "on", "track": "<4201>", "probability": 0.993, "tracks": {"<4201>": 0.995}},
        **{"start_s": 0.0, "end_s": 9.0, "start_chainage_m": 100.0, "end_chainage_m": 300.0},
        **{"across_m": -0.31, "across_m_sd": 1.52},
    }
    unknown = {"track": None, "across_m": None, "across_m_sd": None, "start_chainage_m": 300.0, "end_chainage_m": 350.0}
    undecided = stretch | unknown | {"status": "undecided", "tracks": {"a": 0.6, "b": 0.4}}
    page = result_page(make_result(line={"name": "net.geojson", "stretches": [stretch, undecided]}), "", None)
    text = page.html()
    for expected in ("Of 250 m of the run 200 m are on a track of net.geojson", "a (60 %), b (40 %)", "&lt;4201&gt;"):
        assert expected in text, expected
    assert "-0.3 ± 1.5" in text
    assert "line" in [section.name for section in page.sections]
    many = result_page(make_result(line={"name": "net", "stretches": [stretch, undecided] * 20}), "", None).html()
    assert "All 40 stretches" in many


def test_exceedances_have_a_section_and_are_shaded(result: Result) -> None:
    limit = Limit(standard="rule <1>", level="alert", parameter="twist", base_m=5.0, kind="peak", value_mm=1.9)
    unjudged = limit.model_copy(update={"parameter": "runoff"})
    judgement = judge(result, [limit, unjudged])
    page = result_page(result, "", None, judgement)
    assert [section.name for section in page.sections][:5] == ["summary", "limits", "quality", "curves", "geometry"]
    html = page.html()
    assert "alert (rule &lt;1&gt;)" in html
    assert "where the track was raised" in html
    (strips, _) = geometry_strips(result, pd.DataFrame(), judgement)
    assert [(span.start, span.end) for span in strips.spans] == list(
        zip(judgement.found["from_m"], judgement.found["to_m"], strict=True)
    )
    nothing = result_page(result, "", None, judge(result, [limit.model_copy(update={"value_mm": 99.0})])).html()
    assert "No exceedance of the limits that could be judged" in nothing


def test_limits_beside_a_comparison_are_refused(comparison_folder: Path, tmp_path: Path) -> None:
    with pytest.raises(trackfg.BadInputError, match="limits beside a result only"):
        write_report(comparison_folder, tmp_path / "a.html", limits=LimitChoice("cfr-213"))


def test_a_run_that_did_not_converge_says_so(make_result: Make) -> None:
    solver = {"converged": False, "reason": "30 iterations", "iterations": 30, "cost": 1.0, "degrees_of_freedom": 1}
    assert "did not converge: 30 iterations. Do not trust the sigmas" in text_of(make_result(solver=solver))


def test_what_is_not_to_be_trusted_is_so_named_wherever_it_is_drawn(make_result: Make) -> None:
    """Twist and roll are not, though their curves are drawn as they are, whatever their sigmas."""
    result = make_result(verdicts=[not_trusted("twist"), not_trusted("roll")])
    result = replace(result, geometry=result.geometry.assign(twist_mm_sd=1000.0))
    (strips, _) = geometry_strips(result, pd.DataFrame())
    doubted = [panel for panel in strips.panels if "trusted" in panel.label]
    assert [panel.label for panel in doubted] == ["twist\n(not trusted)"]
    assert doubted[0].lines[0].y.step < 0.01
    assert [panel.label for panel in motion_strips(result).panels][:2] == ["speed", "roll\n(not trusted)"]
    rows = {row.cells[0]: row.cells for row in measured_table(result).rows}
    assert rows["twist"][4:6] == ("not to be trusted", "not to be trusted")
    assert rows["cross-level"][4:6] == ("0.100", "0.100")


def test_limits_of_what_is_not_to_be_trusted_are_not_kept(make_result: Make) -> None:
    result = make_result(rows=1000, verdicts=[not_trusted("twist")])
    limit = Limit(standard="rule", level="alert", parameter="twist", base_m=5.0, kind="peak", value_mm=1.9)
    page = result_page(result, "", None, judge(result, [limit])).html()
    assert re.search(r"the severest: alert; (\d+) not to be trusted", page)
    assert page.count("Not to be trusted in this run: twist.") == 2  # exceedances and quality
    nothing = result_page(result, "", None, judge(result, [limit.model_copy(update={"value_mm": 99.0})])).html()
    assert nothing.count("Not to be trusted in this run: twist.") == 2
    assert 'class="good">No exceedance' not in nothing


def test_settings_that_are_not_the_defaults_stand_out(make_result: Make) -> None:
    text = text_of(make_result(configuration={"output": {"rate_hz": 7.0}, "solver": {"max_iterations": 50}}))
    assert "Other than the defaults: output.rate_hz = 7." in text


def test_no_geometry_no_chart_of_it(result: Result) -> None:
    page = result_page(replace(result, geometry=result.geometry.iloc[:0]), "", None)
    assert "there is no geometry" in page.html()
    assert not any("chainage" in chart.x_label for chart in page.charts() if isinstance(chart, Strips))


def test_rails_where_there_are_lasers(result: Result) -> None:
    rows = len(result.geometry)
    rails = {name: np.full(rows, 0.1 if name.endswith("_sd") else 1.0) for name in RAIL_COLUMNS}
    strips, _ = geometry_strips(replace(result, geometry=result.geometry.assign(**rails)), pd.DataFrame())
    labels = [panel.label.replace("\n", " ") for panel in strips.panels]
    assert labels[:5] == ["level left rail", "level right rail", "alignment left rail", "alignment right rail", "gauge"]
    assert labels[5:] == [
        "cross-level",
        "twist",
        "versine level",
        "versine alignment",
        "gradient",
        "curvature",
        "speed",
    ]


def test_exceedances_of_the_centre_line_are_shaded_at_the_rails(result: Result) -> None:
    rails = {name: 0.1 if name.endswith("_sd") else 0.0 for name in RAIL_COLUMNS}
    both = replace(result, geometry=result.geometry.assign(**rails))
    level = Limit(standard="rule", level="alert", parameter="level", band="D1", kind="peak", value_mm=2.0)
    judgement = judge(both, [level])
    assert set(judgement.found["column"]) == {"level_mm"}
    (strips, _) = geometry_strips(both, pd.DataFrame(), judgement)
    shaded = {strips.panels[span.panel].label for span in strips.spans if span.panel is not None}
    assert shaded == {"level\nleft rail", "level\nright rail"}
    assert len(strips.spans) == 2 * len(judgement.found)


def test_shares_of_warp_are_not_of_cross_level(result: Result) -> None:
    warp = Limit(standard="rule", level="stop", parameter="warp", base_m=18.8976, kind="peak", value_mm=0.1)
    judgement = judge(result, [warp])
    shares = [name for name in track_statistics(result, judgement=judgement) if name.startswith("share")]
    assert shares == ["share_beyond_warp_over_18.9_m_stop"]
    assert "% beyond warp over 18.9 m, stop" in result_page(result, "", None, judgement).html()


@pytest.mark.parametrize(("sections", "stretches"), [(1, 1), (2, 2), (7, 7), (9, 3), (45, 5), (48, 8), (299, 5)])
def test_places_below_a_bar(sections: int, stretches: int) -> None:
    places = bar_places(400.0, 400.0 + 200.0 * sections, 200.0)
    assert len(places) == stretches + 1
    assert np.diff(places) == pytest.approx(200.0 * sections / stretches)


def test_every_quantity_but_speed_has_a_band(result: Result) -> None:
    strips, errors = geometry_strips(result, pd.DataFrame())
    assert errors is None
    assert [panel.label for panel in strips.panels if panel.lines[0].sigma is None] == ["speed"]
    assert strips.x_unit == "m"


def test_truth_is_shown_beside_the_estimate(known: Against) -> None:
    strips, errors = geometry_strips(known.result, known.geometry_errors)
    assert errors is not None
    with_truth = [panel.label for panel in strips.panels if "truth" in {line.name for line in panel.lines}]
    assert with_truth == [panel.label for panel in errors.panels]
    assert "level" in with_truth
    assert strips.legend


def test_errors_are_those_of_the_scores(known: Against) -> None:
    table = error_table(known.geometry_errors)
    (twist,) = (row.cells for row in table.rows if row.cells[0] == "twist")
    error = known.geometry_errors["twist_mm"]
    assert float(twist[3]) == pytest.approx(np.sqrt((error**2).mean()), rel=0.01)
    text = text_of(known.result, known)
    assert "Errors of the geometry" in text
    assert "Error over sigma: trajectory" in text


def test_curvature_is_in_one_unit_everywhere(known: Against) -> None:
    assert (named("curvature_1pm").unit, named("curvature_1pm").scale) == ("1/km", 1000.0)
    (row,) = (row.cells for row in error_table(known.geometry_errors).rows if row.cells[0] == "curvature")
    assert float(row[3]) == pytest.approx(1e3 * np.sqrt((known.geometry_errors["curvature_1pm"] ** 2).mean()), rel=0.01)


def test_true_sigmas_cover_as_the_normal_distribution() -> None:
    rng = np.random.default_rng(0)
    errors = pd.DataFrame({"twist_mm": 0.1 * rng.normal(size=100_000), "twist_mm_sd": 0.1})
    twist, normal = (row.cells for row in coverage_table(errors).rows)
    assert normal[1:] == ("68.3 %", "95.0 %", "99.7 %")
    for found, expected in zip(twist[1:], normal[1:], strict=True):
        assert float(found.split()[0]) == pytest.approx(float(expected.split()[0]), abs=0.4)
    figure = histograms(errors)
    assert figure is not None
    bars, line = figure.traces
    np.testing.assert_allclose(bars["y"], line["y"], atol=0.02)


def test_noise_bars_stand_around_one() -> None:
    figure = noise_bars({"gyro": 1.0, "tach": 2.5, "motion": 1e-5})
    (bars,) = figure.traces
    assert bars["x"] == pytest.approx([0.0, np.log2(2.5), -3.0])
    assert bars["text"] == ["1.00", "2.50", "1.00e-05"]
    assert bars["marker"]["color"][0] == bars["marker"]["color"][2] != bars["marker"]["color"][1]


def test_bad_recordings(run: tuple[Result, Path], make_result: Make, tmp_path: Path) -> None:
    result, recording = run
    with pytest.raises(trackfg.BadInputError, match="'mainline-seed1-run0'; expected 'made-up'"):
        against(make_result(), recording)
    without = tmp_path / "without"
    shutil.copytree(recording, without)
    toml = (without / "recording.toml").read_text()
    (without / "recording.toml").write_text(re.sub(r"\[truth\][^\[]*", "", toml))
    assert against(result, without) is None
    with pytest.raises(trackfg.BadInputError, match="no such folder"):
        against(result, tmp_path / "nowhere")


def test_bad_places(result_folder: Path, comparison_folder: Path, tmp_path: Path) -> None:
    with pytest.raises(trackfg.BadInputError, match=r"ends in \.html"):
        write_report(result_folder, tmp_path / "a.pdf")
    with pytest.raises(trackfg.BadInputError, match="lies in the result"):
        write_report(result_folder, result_folder / "a.html")
    with pytest.raises(trackfg.BadInputError, match=r"a result \(summary.json\) or a comparison \(comparison.json\)"):
        write_report(tmp_path, tmp_path / "a.html")
    with pytest.raises(trackfg.BadInputError, match="beside a result only"):
        write_report(comparison_folder, tmp_path / "a.html", recording=tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_a_long_run_is_seen_at_first_by_few_rows_with_every_peak(make_result: Make) -> None:
    result = make_result(rows=4000)
    result.geometry.loc[12_345, "level_mm"] = 9.0
    strips, _ = geometry_strips(result, pd.DataFrame())
    (level,) = strips.panels[0].lines
    view = strips.views[level]
    assert view is not None
    assert len(view.y.numbers) < 0.2 * len(level.y.numbers) < len(level.y.numbers) == len(result.geometry)
    assert view.y.numbers.max() == 9.0
    assert view.x.numbers[view.y.numbers == 9.0] == pytest.approx(0.25 * 12_345 / 1000.0)
    short, _ = geometry_strips(make_result(rows=100), pd.DataFrame())
    assert set(short.views.values()) == {None}
