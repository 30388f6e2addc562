"""Versines of a measuring car by the inertial and the difference method, and their blends by speed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
import pytest

from trackfg.baselines import mid_chord
from trackfg.baselines.mid_chord import VERSINE_COLUMNS, Method
from trackfg.baselines.mixed_waveform import blended, mixed_waveform
from trackfg.datasets.scenarios import Simulation, simulate
from trackfg.errors import BadInputError
from trackfg.evaluation.geometry_errors import geometry_errors
from trackfg.geometry.moving_average import moving_average
from trackfg.numerics.arrays import Array
from trackfg.numerics.units import KMH, STANDARD_GRAVITY
from trackfg.recording.description import Imu, Laser, RecordingDescription, Tach, Track
from trackfg.recording.model import IMU_COLUMNS, Recording

METHODS: tuple[Method, ...] = ("inertial", "difference", "conventional", "developed")
VERSINES = ("versine_level_mm", "versine_alignment_mm")


@dataclass(frozen=True)
class MadeUp:
    """A car at a steady speed on a flat circle of curvature ``kappa``, without noise, never at rest."""

    speed: float = 15.0
    kappa: float = 0.0
    direction: int = 1
    up_bias: float = 0.0
    apart_m: float = 5.0
    duration_s: float = 20.0

    def recording(self) -> Recording:
        t = np.arange(0.0, self.duration_s, 0.005)
        n = len(t)
        force = np.column_stack(
            [np.zeros(n), np.full(n, self.speed**2 * self.kappa), np.full(n, STANDARD_GRAVITY + self.up_bias)]
        )
        gyro = np.column_stack([np.zeros(n), np.zeros(n), np.full(n, self.speed * self.kappa)])
        lasers, tables = [], {}
        for unit, x in (("A", 0.5 * self.apart_m), ("B", -0.5 * self.apart_m)):
            for rail, y in (("left", 0.5335), ("right", -0.5335)):
                for axis, seen in (("y", 0.5 * self.kappa * x**2), ("z", -0.6)):
                    name = f"{unit}-{rail}-{axis}"
                    lasers.append(
                        Laser(file="-", name=name, column="d", position_m=(x, y, 0.6), axis=axis, rail=rail, sd_m=1e-4)
                    )
                    tables[name] = pd.DataFrame({"t_s": t, "displacement_m": np.full(n, seen)})
        return Recording(
            description=RecordingDescription(
                id="made up",
                track=Track(gauge_m=1.067, cross_level_base_m=1.067, direction=self.direction),
                imu=Imu(file="-", gyro=("a", "b", "c"), accel=("d", "e", "f"), lever_arm_m=(0.0, 0.0, 0.6)),
                tach=Tach(file="-", column="d", kind="distance", unit="m", signed=True),
                laser=tuple(lasers),
            ),
            imu=pd.DataFrame(np.column_stack([t, gyro, force]), columns=list(IMU_COLUMNS)),
            tach=pd.DataFrame({"t_s": t, "distance_m": self.speed * t}),
            lasers=tables,
        )


def middle(geometry: pd.DataFrame, column: str) -> Array:
    """A column's values away from the ends."""
    values = geometry[column].to_numpy()
    return values[len(values) // 3 : -len(values) // 3]


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("direction", [1, -1])
def test_circle_reads_12500_over_its_radius(method: Method, direction: int) -> None:
    result = mid_chord.run(MadeUp(kappa=1.0 / 400.0, direction=direction).recording(), method=method)
    for column in ("versine_alignment_mm", *VERSINE_COLUMNS[2:]):
        np.testing.assert_allclose(middle(result.geometry, column), -direction * 12500.0 / 400.0, atol=0.02)
    np.testing.assert_allclose(middle(result.geometry, "versine_level_mm"), 0.0, atol=0.02)


@pytest.mark.parametrize(("kmh", "error_mm"), [(20.0, 3.97), (40.0, 0.99), (60.0, 0.44)])
def test_a_milligravity_shifts_the_inertial_level_by_its_kernel_and_the_difference_not_at_all(
    kmh: float, error_mm: float
) -> None:
    recording = MadeUp(speed=kmh * KMH, up_bias=1e-3 * STANDARD_GRAVITY, duration_s=30.0).recording()
    inertial = middle(mid_chord.run(recording, method="inertial").geometry, "versine_level_mm")
    difference = middle(mid_chord.run(recording, method="difference").geometry, "versine_level_mm")
    np.testing.assert_allclose(np.abs(inertial), error_mm, atol=0.005)
    np.testing.assert_allclose(difference, 0.0, atol=1e-9)


def test_developed_takes_no_long_wave_from_the_inertial_sensor_between_its_bands() -> None:
    recording = MadeUp(speed=40.0 * KMH, up_bias=1e-3 * STANDARD_GRAVITY).recording()
    developed = middle(mid_chord.run(recording, method="developed").geometry, "versine_level_mm")
    conventional = middle(mid_chord.run(recording, method="conventional").geometry, "versine_level_mm")
    np.testing.assert_allclose(developed, 0.0, atol=1e-6)
    np.testing.assert_allclose(np.abs(conventional), 0.99 * (40.0 - 30.0) / 15.0, atol=0.01)


def test_blend_is_linear_in_its_band_and_blind_to_what_has_no_weight() -> None:
    speed = np.array([20.0, 30.0, 36.0, 45.0, 60.0])
    low, high = np.array([1.0, 1.0, 1.0, np.nan, np.nan]), np.array([np.nan, np.nan, 2.0, 2.0, 2.0])
    np.testing.assert_allclose(blended(low, high, speed, (30.0, 45.0)), [1.0, 1.0, 1.4, 2.0, 2.0])


def test_mixed_waveform_is_the_short_of_one_and_the_long_of_the_other() -> None:
    x = np.arange(0.0, 400.0, 0.25)
    short, long = np.sin(2 * np.pi * x / 8.0), np.sin(2 * np.pi * x / 100.0)
    mixed = mixed_waveform(short + 5.0, long, 0.25, (24.0,))
    np.testing.assert_allclose(mixed[100:-100], (short + moving_average(long, 0.25, 24.0))[100:-100], atol=1e-12)
    np.testing.assert_allclose(
        mixed_waveform(long + short, long + short, 0.25, (24.0, 18.0))[100:-100], (long + short)[100:-100], atol=1e-12
    )


@pytest.fixture(scope="module")
def exact() -> Simulation:
    return simulate("measuring-car", seed=1, noise=False, duration_s=250.0)


@pytest.fixture(scope="module")
def noisy() -> Simulation:
    return simulate("measuring-car", seed=2, duration_s=400.0)


def errors(simulation: Simulation, method: Method) -> pd.DataFrame:
    result = mid_chord.run(simulation.recording, method=method)
    return geometry_errors(result.geometry, result.trajectory, simulation.truth, simulation.truth_geometry)


def mean_size(errors: pd.DataFrame, column: str, from_kmh: float, to_kmh: float) -> float:
    """Mean magnitude of the errors in a band of speeds: what the paper calls the mean difference, mm."""
    speed = errors["speed_mps"] / KMH
    return float(errors[column][(speed >= from_kmh) & (speed < to_kmh)].abs().mean())


def test_without_noise_the_difference_method_is_right_at_all_speeds(exact: Simulation) -> None:
    found = errors(exact, "difference")
    for column in VERSINES:
        assert mean_size(found, column, 0.0, 200.0) < 0.01


def test_without_noise_the_inertial_method_is_right_from_45_kmh_on(exact: Simulation) -> None:
    found = errors(exact, "inertial")
    assert mean_size(found, "versine_level_mm", 45.0, 200.0) < 0.02
    assert mean_size(found, "versine_alignment_mm", 45.0, 200.0) < 0.08


def test_inertial_diverges_below_20_kmh_and_the_difference_method_does_not(noisy: Simulation) -> None:
    inertial, difference = errors(noisy, "inertial"), errors(noisy, "difference")
    for column in VERSINES:
        by_speed = [mean_size(inertial, column, *band) for band in ((0.0, 10.0), (20.0, 45.0), (45.0, 200.0))]
        assert by_speed[0] > 5.0 * by_speed[1]
        assert by_speed[1] > by_speed[2]
        assert mean_size(difference, column, 0.0, 20.0) < 0.5


def test_developed_is_no_worse_than_conventional_and_within_the_papers_half_millimetre(noisy: Simulation) -> None:
    conventional, developed = errors(noisy, "conventional"), errors(noisy, "developed")
    for column in VERSINES:
        assert mean_size(developed, column, 0.0, 200.0) < 0.5
        assert mean_size(conventional, column, 0.0, 200.0) < 1.0
        assert mean_size(developed, column, 45.0, 60.0) < mean_size(conventional, column, 45.0, 60.0)


def test_tables_have_the_contracts_columns_on_whole_multiples_of_the_step(noisy: Simulation) -> None:
    result = mid_chord.run(noisy.recording)
    chainage = result.geometry["chainage_m"].to_numpy()
    np.testing.assert_allclose(np.diff(chainage), 0.25)
    np.testing.assert_allclose(chainage / 0.25, np.rint(chainage / 0.25))
    assert tuple(result.geometry.columns[-4:]) == VERSINE_COLUMNS
    level = result.geometry[list(VERSINE_COLUMNS[:2])].mean(axis=1, skipna=False)
    np.testing.assert_allclose(result.geometry["versine_level_mm"], level, atol=1e-12)
    assert result.parameters["method"] == "developed"
    assert result.parameters["difference_band_kmh"] == "25.0-30.0"


@pytest.mark.parametrize(
    ("spoilt", "method", "message"),
    [
        (lambda r: replace(r, tach=None), "inertial", "no tachometer"),
        (lambda r: replace(r, description=r.description.model_copy(update={"laser": ()})), "inertial", "no unit"),
        (lambda r: MadeUp(apart_m=4.0).recording(), "difference", "4 m apart; expected 5 m"),
        (lambda r: r, "best", "expected inertial, difference, conventional, developed"),
    ],
)
def test_says_what_is_missing(spoilt: Callable[[Recording], Recording], method: Method, message: str) -> None:
    with pytest.raises(BadInputError, match=message):
        mid_chord.run(spoilt(MadeUp().recording()), method=method)
