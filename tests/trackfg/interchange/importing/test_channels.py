"""Channel tables of recording cars become results without a trajectory."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Literal

import numpy as np
import pandas as pd
import pytest
import tomli_w
from typer.testing import CliRunner

from trackfg.cli.main import app
from trackfg.curves import find_curves
from trackfg.errors import BadInputError
from trackfg.geometry.limits import LimitChoice
from trackfg.geometry.twist import ANCHORS, Anchor, twist
from trackfg.interchange.exporting.export import export_result
from trackfg.interchange.exporting.registry import result_format
from trackfg.interchange.importing.channels.channel_names import channel_of
from trackfg.interchange.importing.channels.measured_geometry import measured_result
from trackfg.interchange.importing.channels.source_geometry import geometry_in, read_geometry, source_tables
from trackfg.interchange.importing.channels.straight_offset import straight_offset
from trackfg.interchange.importing.mapping import FORMAT, Mapping, mapping_of
from trackfg.report.track_limits import judge
from trackfg.results.result import Result

STEP = 0.25
X = 12_000.0 + STEP * np.arange(2000)


@pytest.fixture(scope="module")
def waves() -> dict[str, np.ndarray]:
    """Channels of a track as a car writes them: to a hundredth of a millimetre."""
    rng = np.random.default_rng(17)
    smooth = np.hanning(13) / np.hanning(13).sum()
    names = ("level_left", "level_right", "alignment_left", "alignment_right", "cross_level", "gauge")
    return {name: np.round(6.0 * np.convolve(rng.standard_normal(len(X)), smooth, mode="same"), 2) for name in names}


def written(path: Path, table: pd.DataFrame, *, quoting: Literal[0, 2] = csv.QUOTE_MINIMAL) -> Path:
    table.to_csv(path, index=False, quoting=quoting)
    return path


def measured(path: Path, mapping: Mapping | None = None) -> Result:
    found = geometry_in(source_tables(path, None, mapping)[1], mapping, path.stem)
    assert found is not None
    return measured_result(*found)


def kilometres(x: np.ndarray) -> pd.DataFrame:
    km = np.floor(x / 1000.0)
    return pd.DataFrame({"km": km.astype(int), "m": x - 1000.0 * km})


def test_kilometres_metres_left_and_right(tmp_path: Path, waves: dict[str, np.ndarray]) -> None:
    table = kilometres(X).assign(left=waves["level_left"], right=waves["level_right"])
    rising = measured(written(tmp_path / "a.txt", table))
    falling = measured(written(tmp_path / "b.txt", table.iloc[::-1]))
    np.testing.assert_array_equal(rising.geometry["chainage_m"], X)
    np.testing.assert_array_equal(rising.geometry["level_left_mm"], waves["level_left"])
    np.testing.assert_allclose(rising.geometry["level_mm"], 0.5 * (waves["level_left"] + waves["level_right"]))
    pd.testing.assert_frame_equal(falling.geometry, rising.geometry)
    assert rising.summary.run is not None
    assert falling.summary.run is not None
    assert (rising.summary.run.direction, falling.summary.run.direction) == (1, -1)
    assert rising.geometry["level_left_mm_sd"].isna().all()


def test_facing_the_travel_the_rails_change_places(tmp_path: Path, waves: dict[str, np.ndarray]) -> None:
    table = kilometres(X).assign(left=waves["level_left"], right=waves["level_right"], cant=waves["cross_level"])
    path = written(tmp_path / "run.csv", table.iloc[::-1])
    section = {"place": ["km", "m"], "facing": "travel"}
    channels = {"level_left_mm": "left", "level_right_mm": "right", "cross_level_mm": "cant"}
    mapping = mapping_of({"format": FORMAT, "geometry": {**section, "channels": channels}}, "m.toml")
    geometry = measured(path, mapping).geometry
    np.testing.assert_array_equal(geometry["level_left_mm"], waves["level_right"])
    np.testing.assert_array_equal(geometry["cross_level_mm"], -waves["cross_level"])


def test_an_office_file_of_finland(tmp_path: Path, waves: dict[str, np.ndarray]) -> None:
    names = {
        "TG Master.Raideleveyden Poikkeama [mm]": waves["gauge"],
        "TG Master.Kallistus [mm]": waves["cross_level"],
        "TG Master.Kallistuksen Poikkeama [mm]": 0.1 * waves["cross_level"],
        "TG Master.Kierous [mm]": twist(waves["cross_level"], STEP, 3.0, "ahead"),
        "TG Master.Kaarevuus [10000/m]": 0.0 * X + 12.5,
        "TG Master.Vasen Korkeuspoikkeama D1 [mm]": waves["level_left"],
        "TG Master.Vasen Korkeuspoikkeama D2 [mm]": 2.0 * waves["level_left"],
        "TG Master.Oikea Korkeuspoikkeama D2 [mm]": 2.0 * waves["level_right"],
        "TG Master.Oikea Nuolikorkeuspoikkeama D1 [mm]": waves["alignment_right"],
        "TG Master.Vasen Korkeuspoikkeama D1 Keskihajonta [mm]": 0.0 * X,
        "Ajonopeus [Km/h]": 0.0 * X + 72.0,
    }
    km = np.floor(X / 1000.0).astype(int)
    places = [f"{k}+{m:07.2f}" for k, m in zip(km, X - 1000.0 * km, strict=True)]
    table = pd.DataFrame({"SSCount": np.arange(len(X)), "Track": "003", "Location [km+m]": places} | names)
    result = measured(written(tmp_path / "TG_003.csv", table, quoting=csv.QUOTE_NONNUMERIC))
    geometry = result.geometry
    np.testing.assert_allclose(geometry["chainage_m"], X)
    np.testing.assert_allclose(geometry["gauge_mm"], 1435.0 + waves["gauge"])
    np.testing.assert_array_equal(geometry["cross_level_mm"], waves["cross_level"])
    np.testing.assert_allclose(geometry["curvature_1pm"], 1.25e-3)
    np.testing.assert_allclose(geometry["speed_mps"], 20.0)
    np.testing.assert_array_equal(geometry["level_left_mm"], waves["level_left"])
    np.testing.assert_array_equal(geometry["level_right_d2_mm"], 2.0 * waves["level_right"])
    np.testing.assert_allclose(geometry["level_d2_mm"], waves["level_left"] + waves["level_right"])
    np.testing.assert_array_equal(geometry["alignment_right_mm"], waves["alignment_right"])
    assert (result.summary.geometry.twist_base_m, result.summary.geometry.twist_anchor) == (3.0, "ahead")


@pytest.mark.parametrize("anchor", ANCHORS)
@pytest.mark.parametrize("base_m", [2.5, 3.0, 6.0])
def test_a_recorded_twist_is_that_of_the_cross_level(
    tmp_path: Path, waves: dict[str, np.ndarray], base_m: float, anchor: Anchor
) -> None:
    recorded = np.round(-twist(waves["cross_level"], STEP, base_m, anchor), 1)
    table = pd.DataFrame({"chainage_m": X, "cant [mm]": waves["cross_level"], "twist [mm]": recorded})
    result = measured(written(tmp_path / "run.csv", table))
    meaning = result.summary.geometry
    assert (meaning.twist_base_m, meaning.twist_anchor) == (base_m, anchor)
    level, seen = (result.geometry[f"{name}_mm"].to_numpy() for name in ("cross_level", "twist"))
    computed = twist(level, meaning.step_m, meaning.twist_base_m, meaning.twist_anchor)
    both = np.isfinite(seen) & np.isfinite(computed)
    assert both.sum() > 1900
    assert np.abs(computed - seen)[both].max() <= 0.05 + 1e-9
    assert "minus" in next(f.message for f in result.summary.findings if f.code == "twist-base")


def test_a_versine_shows_the_curvature_without_its_offset(tmp_path: Path) -> None:
    x = STEP * np.arange(12_000)
    curvature = np.interp(x, [800, 860, 1300, 1360, 1900, 1950, 2400, 2450], [0, 2e-3, 2e-3, 0, 0, -1e-3, -1e-3, 0])
    noise = 0.3 * np.random.default_rng(3).standard_normal(len(x))
    table = pd.DataFrame({"chainage_m": x, "versine [mm]": np.round(-12_500.0 * curvature + 1.7 + noise, 2)})
    result = measured(written(tmp_path / "run.csv", table))
    off = (result.geometry["curvature_1pm"] - curvature).mean()
    assert abs(off) < 0.05 / 12_500.0
    assert straight_offset(np.full(500, np.nan), STEP) == 0.0


def test_rows_off_the_grid_are_brought_to_it(tmp_path: Path) -> None:
    x = 100.1 + STEP * np.arange(2000)
    jittered = x + np.random.default_rng(1).uniform(-0.1, 0.1, len(x))

    def wave(at: np.ndarray) -> np.ndarray:
        return np.asarray(2.0 * np.sin(2.0 * np.pi * at / 8.0))

    for places in (x, jittered):
        result = measured(written(tmp_path / "run.csv", pd.DataFrame({"chainage_m": places, "level": wave(places)})))
        rows = result.geometry.dropna(subset=["level_mm"])
        assert len(rows) > 1950
        assert np.allclose(rows["chainage_m"] % STEP, 0.0)
        np.testing.assert_allclose(rows["level_mm"], wave(rows["chainage_m"].to_numpy()), atol=0.03)


def test_what_is_no_profile_is_refused_with_its_row(tmp_path: Path, waves: dict[str, np.ndarray]) -> None:
    table = kilometres(X).assign(left=waves["level_left"], right=waves["level_right"])
    table.loc[700:, "m"] -= 3.0
    with pytest.raises(BadInputError, match=r"run\.csv: column 'km' and 'm', row 702: .* expected places that rise"):
        measured(written(tmp_path / "run.csv", table))
    with pytest.raises(BadInputError, match="neither a result nor a table of track geometry"):
        read_geometry(written(tmp_path / "other.csv", pd.DataFrame({"a": [1, 2], "b": [3, 4]})))
    written(tmp_path / "comparison.json", table)
    with pytest.raises(BadInputError, match="is a comparison; expected a trackfg result"):
        read_geometry(tmp_path)
    with pytest.raises(BadInputError, match="no column 'level_lefft_mm' of a geometry"):
        mapping_of({"format": FORMAT, "geometry": {"place": "x", "channels": {"level_lefft_mm": "a"}}}, "m.toml")


def test_what_names_mean() -> None:
    meant = {
        "Left level D1 [mm]": "level_left_mm",
        "Cross-level sigma [mm]": "cross_level_mm_sd",
        "Right alignment D2 [mm]": "alignment_right_d2_mm",
        "LEVEL_LEFT": "level_left_mm",
        "CROSS_LEVEL_SD": "cross_level_mm_sd",
        "Gradient [permille]": "gradient_permille",
        "左高低(mm)": "level_left_mm",
        "右轨向": "alignment_right_mm",
        "三角坑": "twist_mm",
        "versine level [mm]": "versine_level_mm",
        "SD left level [mm]": None,
        "Curvature [1/furlong]": None,
        "Row": None,
    }
    for name, column in meant.items():
        channel = channel_of(name)
        assert (None if channel is None else channel.column) == column, name


HEADERS = [
    "Location [km],LL_L,LL_R,AL_L,AL_R,CL,G",
    "km,LH li,LH re,Ri li,Ri re,Üh,SpW",
    "PK,NL G,NL D,D G,D D,Dévers,Ecart.",
    "PK (km),Nivellement longitudinal file gauche,Nivellement longitudinal file droite,Dressage file gauche,"
    "Dressage file droite,Dévers,Écartement",
    "Progressiva [km],Livello longitudinale sx,Livello longitudinale dx,Allineamento sx,Allineamento dx,"
    "Sopraelevazione,Scartamento",
    "PK,Nivelación longitudinal izquierda,Nivelación longitudinal derecha,Alineación izquierda,Alineación derecha,"
    "Peralte,Ancho de vía",
    "Kilometer,Hoogteligging links,Hoogteligging rechts,Schift links,Schift rechts,Verkanting,Spoorwijdte",
    "Km,Höjdläge vänster,Höjdläge höger,Sidoläge vänster,Sidoläge höger,Rälsförhöjning,Spårvidd",
    "km,Výška levá,Výška pravá,Směr levý,Směr pravý,Převýšení,Rozchod koleje",
    "km,Nierówność pionowa lewa,Nierówność pionowa prawa,Nierówność pozioma lewa,Nierówność pozioma prawa,"
    "Przechyłka,Szerokość toru",
]
"""Level, alignment, cross-level and gauge in the words and abbreviations of recording cars."""


@pytest.mark.parametrize("header", HEADERS)
def test_names_in_several_languages(header: str, tmp_path: Path, waves: dict[str, np.ndarray]) -> None:
    columns = [X / 1000.0, *(waves[name] for name in list(waves)[:5]), 1435.0 + waves["gauge"]]
    place, *channels = header.split(",")
    names = [place, *(f"{channel} [mm]" for channel in channels)]
    path = written(tmp_path / "car.csv", pd.DataFrame(dict(zip(names, columns, strict=True))))
    geometry = measured(path).geometry
    for name, values in waves.items():
        expected = values + (1435.0 if name == "gauge" else 0.0)
        np.testing.assert_allclose(geometry[f"{name}_mm"], expected, atol=1e-6)


@pytest.mark.parametrize("name", ["LPROF62 (in)", "Left Align 31", "RALIGN_62", "Surface 124 ft (in)"])
def test_an_offset_from_a_chord_is_neither_level_nor_alignment(name: str) -> None:
    assert channel_of(name) is None


def test_a_letter_is_a_channel_beside_a_level_alone() -> None:
    assert channel_of("G", "mm") is None
    channel = channel_of("G", "mm", beside_level=True)
    assert channel is not None
    assert channel.column == "gauge_mm"


def test_columns_that_are_no_channels_are_named(tmp_path: Path, waves: dict[str, np.ndarray]) -> None:
    table = kilometres(X).assign(left=waves["level_left"], right=waves["level_right"], riding_index=1.0)
    path = written(tmp_path / "car.csv", table)
    run = CliRunner().invoke(app, ["import", str(path), "-o", str(tmp_path / "out")])
    assert run.exit_code == 0, run.output
    assert "not used of car.csv: riding_index" in run.output


def test_our_own_channel_file_comes_back(tmp_path: Path, waves: dict[str, np.ndarray]) -> None:
    table = pd.DataFrame({"chainage_m": X} | {f"{name}_mm": values for name, values in waves.items()})
    first = measured(written(tmp_path / "run.csv", table))
    path = export_result(first, result_format("channels"), tmp_path / "channels.csv")
    again = measured(path)
    for name in ("chainage_m", "level_left_mm", "alignment_right_mm", "cross_level_mm", "twist_mm", "gauge_mm"):
        np.testing.assert_allclose(again.geometry[name], first.geometry[name], atol=6e-4, err_msg=name)
    assert again.summary.geometry == first.summary.geometry
    with pytest.raises(BadInputError, match="without a trajectory"):
        export_result(first, result_format("tum"), tmp_path / "run.tum")


def test_the_command_line(tmp_path: Path, waves: dict[str, np.ndarray]) -> None:
    table = kilometres(X).assign(left=5.0 * waves["level_left"], right=waves["level_right"])
    source = written(tmp_path / "run.txt", table)
    run, out = CliRunner(), tmp_path / "out"
    done = run.invoke(app, ["import", str(source), "-o", str(out)])
    assert done.exit_code == 0, done.output
    assert "geometry: 2000 rows from 12000.00 m to 12499.75 m" in done.output
    result = Result.read(out)
    assert result.summary.solver is None
    assert result.trajectory.empty
    rule = {"standard": "rule", "level": "alert", "parameter": "level", "band": "D1", "kind": "peak", "value_mm": 8.0}
    (tmp_path / "rule.toml").write_text(tomli_w.dumps({"limits": [rule]}))
    found = run.invoke(app, ["limits", str(out), "--limits", str(tmp_path / "rule.toml"), "--json"])
    assert found.exit_code == 0, found.output
    assert '"column": "level_left_mm"' in found.output
    for command in (["plot", str(out), "-o", str(tmp_path / "a.png")], ["report", str(out)]):
        assert run.invoke(app, command).exit_code == 0


def test_statistics_maps_changes_and_curves_of_measured_geometry(tmp_path: Path) -> None:
    x = STEP * np.arange(10_000)
    curvature = np.interp(x, [600, 660, 1100, 1160], [0.0, 2e-3, 2e-3, 0.0])
    smooth = np.hanning(25) / np.linalg.norm(np.hanning(25))
    rng = np.random.default_rng(5)
    rough = {name: 0.8 * np.convolve(rng.standard_normal(len(x)), smooth, mode="same") for name in ("v", "l", "c")}
    dip = -6.0 * np.exp(-0.5 * ((x - 1800.0) / 1.5) ** 2)
    for name, changed in (("before", 0.0), ("after", 1.0)):
        noise = [0.05 * rng.standard_normal(len(x)) for _ in range(3)]
        table = pd.DataFrame(
            {
                "chainage_m": x,
                "versine [mm]": np.round(-12_500.0 * curvature + 1.4 + rough["v"] + noise[0], 2),
                "level [mm]": np.round(rough["l"] + changed * dip + noise[1], 2),
                "cross-level [mm]": np.round(-40_000.0 * curvature + rough["c"] + noise[2], 2),
            }
        )
        measured(written(tmp_path / f"{name}.csv", table)).write(tmp_path / name)
    run, line, after = CliRunner(), str(tmp_path / "line.gpkg"), str(tmp_path / "after")
    built = run.invoke(app, ["map", "build", str(tmp_path / "before"), "-o", line])
    assert built.exit_code == 0, built.output
    found = run.invoke(app, ["map", "changes", after, line, "-o", str(tmp_path / "changes.csv")])
    assert found.exit_code == 0, found.output
    changes = pd.read_csv(tmp_path / "changes.csv")
    assert len(changes) == 1
    assert changes["from_m"].iloc[0] < 1800.0 < changes["to_m"].iloc[0]
    (curve,) = find_curves(Result.read(tmp_path / "before").geometry)
    assert curve.radius_m == pytest.approx(500.0, rel=0.01)
    assert curve.btc_m == pytest.approx(600.0, abs=4.0)
    printed = run.invoke(app, ["statistics", after, "--limits", "cfr-213-class-4", "--json"])
    assert printed.exit_code == 0, printed.output
    assert '"sd_level_mm"' in printed.output
    assert '"tqi"' in printed.output


def test_init_writes_the_mapping_that_repeats_it(tmp_path: Path, waves: dict[str, np.ndarray]) -> None:
    table = kilometres(X).assign(left=waves["level_left"], right=waves["level_right"])
    source, run = written(tmp_path / "run.txt", table), CliRunner()
    first = run.invoke(app, ["init", str(source), "-o", str(tmp_path / "a")])
    assert first.exit_code == 0, first.output
    mapping = str(tmp_path / "a.mapping.toml")
    again = run.invoke(app, ["import", str(source), "-o", str(tmp_path / "b"), "--mapping", mapping])
    assert again.exit_code == 0, again.output
    a, b = (Result.read(tmp_path / name) for name in "ab")
    pd.testing.assert_frame_equal(a.geometry, b.geometry)
    renamed = source.rename(tmp_path / "next.txt")
    following = run.invoke(app, ["import", str(renamed), "-o", str(tmp_path / "c"), "--mapping", mapping])
    assert following.exit_code == 0, following.output
    pd.testing.assert_frame_equal(Result.read(tmp_path / "c").geometry, a.geometry)


def test_limits_of_a_long_band_hold_for_its_channel(tmp_path: Path, waves: dict[str, np.ndarray]) -> None:
    table = pd.DataFrame({"chainage_m": X, "Left level D2 [mm]": 2.0 * waves["level_left"]})
    result = measured(written(tmp_path / "run.csv", table))
    entry = {"standard": "rule", "level": "alert", "parameter": "level", "band": "D2", "kind": "peak", "value_mm": 8.0}
    (tmp_path / "rule.toml").write_text(tomli_w.dumps({"limits": [entry]}))
    judgement = judge(result, LimitChoice(str(tmp_path / "rule.toml"), None).table())
    assert set(judgement.found["column"]) == {"level_left_d2_mm"}
    assert judgement.found["value_mm"].abs().max() == pytest.approx(2.0 * np.abs(waves["level_left"]).max())


@pytest.mark.parametrize("prefix", ["", "[PLATFORM]."])
def test_rcm_dx_with_the_positions_of_the_run(tmp_path: Path, waves: dict[str, np.ndarray], prefix: str) -> None:
    h5py = pytest.importorskip("h5py")
    t = 1_700_000_000_000_000_000 + np.round(1e9 * (X[-1] - X) / 20.0).astype(np.uint64)[::-1]
    path = tmp_path / "run.rcmdx"
    with h5py.File(path, "w") as file:
        session = file.create_group("RCMDX/CAR/20231114_221320.000")
        position = session.create_group(f"{prefix}POSITION/{prefix}POSITION.SOURCE")
        position["timestamp"] = t[::8]
        position.create_group(f"{prefix}POSITION.SOURCE.DATA")["lineoffset"] = X[::-1][::8] / 1000.0
        source = session.create_group(f"{prefix}TGMS/{prefix}GEOMETRY")
        source["timestamp"] = t[:-8]
        for name in ("level_left", "level_right", "cross_level"):
            channel = source.create_group(f"{prefix}{name.upper()}")
            channel.create_dataset("data", data=waves[name][::-1][:-8]).attrs["Unit"] = "mm"
    result = measured(path)
    assert result.summary.run is not None
    assert result.summary.run.direction == -1
    geometry = result.geometry.set_index("chainage_m")
    rows = X[8:]
    np.testing.assert_allclose(geometry.loc[rows, "level_left_mm"], waves["level_left"][8:], atol=0.05)
    np.testing.assert_allclose(geometry.loc[rows, "cross_level_mm"], waves["cross_level"][8:], atol=0.05)


def _table(folder: Path, columns: dict[str, np.ndarray], name: str = "car.csv") -> Path:
    pd.DataFrame(columns).to_csv(folder / name, index=False)
    return folder / name


def test_miles_inches_and_a_gap_are_what_they_are(tmp_path):
    falling = 45_000.0 - 0.25 * np.arange(800)
    level = 5.0 * np.sin(falling / 3.0)
    columns = {"Milepost": falling / 1609.344, "Left Profile (in)": level / 25.4, "Gage (in)": 56.5 + 0.0 * level}
    path = _table(tmp_path, {name: np.delete(values, slice(300, 340)) for name, values in columns.items()})

    geometry = read_geometry(path).geometry

    assert len(geometry) == 800
    inside = geometry["chainage_m"].between(falling[339], falling[300])
    assert geometry["level_left_mm"][inside].isna().all()
    at = geometry["chainage_m"][~inside]
    np.testing.assert_allclose(geometry["level_left_mm"][~inside], 5.0 * np.sin(at / 3.0), atol=1e-3)
    np.testing.assert_allclose(geometry["gauge_mm"][~inside], 1435.1)


@pytest.mark.parametrize("places", [[12_000.0], [12_000.0, 12_000.0], [12_000.05, 12_000.3]])
def test_a_single_place_is_no_profile(places: list[float], tmp_path: Path) -> None:
    """One, one that is written twice, and two that have one place of the grid between them."""
    ones = np.ones(len(places))
    table = pd.DataFrame({"chainage_m": places, "level_left_mm": ones, "level_right_mm": ones})
    with pytest.raises(BadInputError, match=r"run\.csv: 1 different places; expected a profile"):
        measured(written(tmp_path / "run.csv", table))


def test_rows_that_are_written_twice_count_once_and_other_repetitions_are_refused(tmp_path):
    x = 0.25 * np.array([*range(50), 49, *range(50, 100)])
    twice = {"Chainage (m)": x, "Left level (mm)": np.sin(x), "Crosslevel (mm)": np.cos(x)}

    geometry = read_geometry(_table(tmp_path, twice)).geometry

    np.testing.assert_allclose(geometry["level_left_mm"], np.sin(0.25 * np.arange(100)))
    twice["Left level (mm)"][50] += 1.0
    with pytest.raises(BadInputError, match=r"row 52: 12\.25 m after 12\.25 m"):
        read_geometry(_table(tmp_path, twice))


@pytest.mark.parametrize("rising", [True, False])
def test_miles_and_feet_run_on_where_a_mile_has_other_than_5280_feet(
    tmp_path: Path, waves: dict[str, np.ndarray], rising: bool
) -> None:
    lengths = [5280, 5310, 4990]
    rows = pd.concat([pd.DataFrame({"MP": 12 + i, "FEET": np.arange(0, n, 10)}) for i, n in enumerate(lengths)])
    level = np.resize(waves["level_left"], len(rows))
    table = rows.assign(left=level, right=-level)[:: 1 if rising else -1]

    result = measured(written(tmp_path / "chart.csv", table))

    # From the first row the track is as long as its miles are, in whichever direction they are counted.
    first = 1609.344 * table["MP"].iloc[0] + 0.3048 * table["FEET"].iloc[0]
    way = 0.3048 * 10.0 * (len(rows) - 1)
    expected = (first, first + way) if rising else (first - way, first)
    np.testing.assert_allclose(result.geometry["chainage_m"].iloc[[0, -1]], expected, atol=0.3)
    assert result.geometry["level_left_mm"].notna().mean() > 0.99


def test_french_names_and_kilometres_without_a_unit(tmp_path):
    x = 0.25 * np.arange(200)
    names = {"Nivellement G": "level_left_mm", "Dressage D": "alignment_right_mm", "Dévers": "cross_level_mm"}
    columns = {name: np.sin(x / (3.0 + i)) for i, name in enumerate(names)}

    geometry = read_geometry(_table(tmp_path, {"PK": 12.0 + x / 1000.0, **columns})).geometry

    np.testing.assert_allclose(geometry["chainage_m"], 12_000.0 + x)
    for name, column in names.items():
        np.testing.assert_allclose(geometry[column], columns[name])


def test_rows_too_close_for_metres_are_named(tmp_path):
    x = 12.0 + 0.00025 * np.arange(200)

    with pytest.raises(BadInputError, match="chainage_unit"):
        read_geometry(_table(tmp_path, {"Position": x, "Left level": np.sin(x)}))


def test_a_gauge_of_some_millimetres_is_a_deviation(tmp_path):
    x = 0.25 * np.arange(200)
    path = _table(tmp_path, {"Chainage (m)": x, "Spurweite (mm)": 2.0 * np.sin(x), "Crosslevel (mm)": np.cos(x)})

    result = read_geometry(path)

    assert result.summary.geometry.gauge_m == 1.435
    np.testing.assert_allclose(result.geometry["gauge_mm"], 1435.0 + 2.0 * np.sin(x))


@pytest.mark.parametrize("gauge", [1.435, -368.0])
def test_a_gauge_in_another_unit_or_from_another_gauge_is_refused(gauge: float, tmp_path: Path) -> None:
    x = 0.25 * np.arange(200)
    path = _table(tmp_path, {"Chainage (m)": x, "Gauge": gauge + 0.002 * np.sin(x), "Crosslevel (mm)": np.cos(x)})

    with pytest.raises(BadInputError, match=r"column 'Gauge' has the median .*; expected a gauge, 300 to 4000 mm"):
        read_geometry(path)


def test_a_mapping_may_state_the_base_of_the_cross_level_alone(tmp_path: Path) -> None:
    x = 0.25 * np.arange(200)
    path = _table(tmp_path, {"km": 12.0 + 0.001 * x, "Überhöhung (mm)": np.cos(x), "Spurweite (mm)": 1435.0 + 0.0 * x})
    stated = mapping_of({"format": FORMAT, "geometry": {"cross_level_base_m": 1.435}}, "m.toml")

    result, plain = measured(path, stated), read_geometry(path)

    assert result.summary.geometry.cross_level_base_m == 1.435
    assert plain.summary.geometry.cross_level_base_m == 1.5
    pd.testing.assert_frame_equal(result.geometry, plain.geometry)


def test_a_mapping_may_state_the_channels_alone(tmp_path: Path) -> None:
    """A channel that it leaves out is not read."""
    x = 0.25 * np.arange(200)
    path = _table(tmp_path, {"km": 12.0 + 0.001 * x, "s": np.cos(x), "Gauge (mm)": 1435.0 + 0.0 * x})
    stated = mapping_of({"format": FORMAT, "geometry": {"channels": {"cross_level_mm": "s"}}}, "m.toml")

    geometry = measured(path, stated).geometry

    np.testing.assert_allclose(geometry["chainage_m"], 12000.0 + x, atol=1e-6)
    assert "gauge_mm" not in geometry


def test_a_mapping_without_a_place_that_no_name_shows_is_refused(tmp_path: Path) -> None:
    path = _table(tmp_path, {"a": 0.25 * np.arange(200), "b": np.ones(200)})
    stated = mapping_of({"format": FORMAT, "geometry": {"channels": {"cross_level_mm": "b"}}}, "m.toml")

    with pytest.raises(BadInputError, match=r"m\.toml: section \[geometry\] states no place"):
        measured(path, stated)
