"""Runs of recording cars over one line, by channel tables as they write them, laid over each other."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.interpolate import CubicSpline
from typer.testing import CliRunner

from trackfg.cli import overlay as overlay_command
from trackfg.cli.main import app
from trackfg.errors import BadInputError
from trackfg.interchange.importing.channels.measured_geometry import measured_result
from trackfg.interchange.importing.channels.source_geometry import geometry_in, read_geometry, source_tables
from trackfg.interchange.importing.mapping import FORMAT, mapping_of
from trackfg.mapping.runs.run_overlay import RunOverlay, overlaid
from trackfg.numerics.arrays import Array

STEP = 0.25
Drift = Callable[[Array], Array]


def irregularities(length_m: float, seed: int) -> CubicSpline:
    """Waves of 2 to 40 m with a spectrum that falls with the square of the frequency, of 1 mm rms."""
    rng = np.random.default_rng(seed)
    fine = 0.125
    n = int((length_m + 100.0) / fine)
    f = np.fft.rfftfreq(n, fine)
    shape = np.where((f > 1.0 / 40.0) & (f < 0.5), 1.0 / np.maximum(f, 1e-3), 0.0)
    z = np.fft.irfft(shape * (rng.standard_normal(len(f)) + 1j * rng.standard_normal(len(f))), n)
    return CubicSpline(fine * np.arange(n) - 50.0, z / z.std())


def table(
    length_m: float,
    track: int,
    noise: int,
    *,
    drift: Drift | None = None,
    noise_mm: float = 0.15,
    falling: bool = False,
) -> pd.DataFrame:
    """What a car writes at chainages from 0: kilometres, metres, left and right level, to a hundredth of a mm."""
    rng = np.random.default_rng([noise, 99])
    x = STEP * np.arange(round(length_m / STEP))
    place = x if drift is None else x - drift(x)
    km = np.floor(x / 1000.0)
    columns = {"km": km.astype(int), "m": x - 1000.0 * km}
    both = irregularities(length_m, track)(place)
    for number, rail in enumerate(("left", "right"), start=1):
        own = irregularities(length_m, track + 1000 * number)(place)
        columns[rail] = np.round(both + 0.6 * own + noise_mm * rng.standard_normal(len(x)), 2)
    frame = pd.DataFrame(columns)
    return frame.iloc[::-1] if falling else frame


def laid(folder: Path, *tables: pd.DataFrame) -> RunOverlay:
    paths = [folder / f"{name}.txt" for name, _ in zip("abcdef", tables, strict=False)]
    for path, frame in zip(paths, tables, strict=True):
        frame.to_csv(path, index=False)
    return overlaid([read_geometry(path) for path in paths], [path.stem for path in paths])


def wandering(x: Array) -> Array:
    """6 m too much at once, and then the wheel: a scale of half a permille and a slow wave."""
    return np.asarray(6.0 + 5e-4 * x + 0.4 * np.sin(2.0 * np.pi * x / 2500.0))


@pytest.mark.parametrize("falling", [False, True])
def test_a_known_drift_is_found_without_a_hint(tmp_path: Path, falling: bool) -> None:
    overlay = laid(tmp_path, table(5000.0, 1, 1), table(5000.0, 1, 2, drift=wandering, falling=falling))
    shifts = overlay.shifts
    error = (shifts["shift_m"] - wandering(shifts["run_m"].to_numpy())).to_numpy()
    assert len(shifts) >= 48
    assert np.mean(np.abs(error) < 0.05) >= 0.95
    assert np.mean(np.abs(error) < 2.0 * shifts["shift_m_sd"]) >= 0.95
    assert shifts["shift_m_sd"].median() < 0.04  # no sigma that holds anything
    repeated = overlay.repeatability.set_index("channel")
    assert repeated.loc["level_left_mm", "sd_median"] == pytest.approx(0.15 * np.sqrt(2.0), rel=0.1)
    assert repeated.loc["level_mm", "sd_max"] < 0.2
    assert set(overlay.differences["channel"]) >= {"level_left_mm", "level_right_mm", "level_mm"}


def test_an_offset_of_kilometres_and_a_part_of_the_line(tmp_path: Path) -> None:
    whole = table(6000.0, 1, 1)
    part = table(6000.0, 1, 2).iloc[8000:16000]
    part = part.assign(km=part["km"] + 70)
    shifts = laid(tmp_path, whole, part).shifts
    assert len(shifts) >= 18
    np.testing.assert_allclose(shifts["shift_m"], 70_000.0, atol=0.1)


def test_incoherent_short_waves_do_not_matter(tmp_path: Path) -> None:
    """Below 3 m the two runs share nothing: their raw slopes of 0.25 m are mostly those of noise."""
    overlay = laid(
        tmp_path,
        table(3000.0, 1, 1, noise_mm=0.5),
        table(3000.0, 1, 2, noise_mm=0.5, drift=lambda x: np.full_like(x, 6.0)),
    )
    shifts = overlay.shifts
    assert len(shifts) >= 27
    assert np.mean(np.abs(shifts["shift_m"] - 6.0) < 2.0 * shifts["shift_m_sd"]) >= 0.9
    assert np.abs(shifts["shift_m"] - 6.0).max() < 0.3


def test_no_overlap_is_said(tmp_path: Path) -> None:
    with pytest.raises(
        BadInputError, match="b: no overlap: its track, 0 m to 3000 m, is recognised nowhere on that of a"
    ):
        laid(tmp_path, table(3000.0, 1, 1), table(3000.0, 2, 2))
    apart = table(3000.0, 2, 2)
    with pytest.raises(BadInputError, match="no overlap"):
        laid(tmp_path, table(3000.0, 1, 1), apart.assign(km=apart["km"] + 400))


def test_the_command_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name, noise in (("a", 1), ("b", 2), ("c", 3)):
        drift = None if noise == 1 else wandering
        table(2000.0, 1, noise, drift=drift).to_csv(tmp_path / f"{name}.csv", index=False)
    a, b, c = (str(tmp_path / f"{name}.csv") for name in "abc")
    run, out = CliRunner(), tmp_path / "overlay"
    assert run.invoke(app, ["import", b, "-o", str(tmp_path / "b")]).exit_code == 0
    done = run.invoke(app, ["overlay", a, str(tmp_path / "b"), c, "-o", str(out), "--json"])
    assert done.exit_code == 0, done.output
    content = json.loads(done.output)
    assert content["reference"] == "a"
    assert {row["run"] for row in content["shifts"]} == {"b", "c"}
    written = pd.read_csv(out / "shifts.csv")
    assert len(written) == len(content["shifts"])
    page = (out / "page.html").read_text(encoding="utf-8")
    assert "Repeatability" in page
    shown = run.invoke(app, ["overlay", a, b])
    assert shown.exit_code == 0
    assert "Repeatability: standard deviation" in shown.output
    assert not re.search(r"-0\.0+\b", shown.output)
    monkeypatch.setattr(overlay_command, "_MOST_ROWS", 3)
    assert "sections more: -o writes all" in run.invoke(app, ["overlay", a, b]).output
    written_too = run.invoke(app, ["overlay", a, b, "-o", str(out)], env={"COLUMNS": "300"}).output
    assert f"sections more: all are in {out / 'shifts.csv'}" in written_too
    alone = run.invoke(app, ["overlay", a])
    assert isinstance(alone.exception, BadInputError)


def test_cross_levels_on_different_bases_are_brought_to_that_of_the_first_run(tmp_path: Path) -> None:
    """One car states the cross-level of the rails' middles, another that of the gauge."""
    x = STEP * np.arange(8000)
    waves = 30.0 * irregularities(2000.0, 7)(x)
    results = []
    for name, base_m in (("a", 1.5), ("b", 1.435)):
        cross_level = np.round(waves * base_m / 1.5, 3)
        pd.DataFrame({"km": 0, "m": x, "cross-level": cross_level}).to_csv(tmp_path / f"{name}.csv", index=False)
        mapping = mapping_of({"format": FORMAT, "geometry": {"cross_level_base_m": base_m}}, f"{name}.toml")
        measured = geometry_in(source_tables(tmp_path / f"{name}.csv", None, mapping)[1], mapping, name)
        assert measured is not None
        results.append(measured_result(*measured))

    overlay = overlaid(results, ["a", "b"])

    assert results[1].geometry["cross_level_mm"].max() < 0.97 * results[0].geometry["cross_level_mm"].max()
    assert set(overlay.repeatability["channel"]) == {"cross_level_mm", "twist_mm"}
    assert overlay.repeatability["sd_max"].max() < 0.01
