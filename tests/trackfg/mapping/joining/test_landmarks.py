"""Landmarks of curves: each point once, covariance that fits together, and ids that outlive changes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from trackfg.curves import POINTS, Curve
from trackfg.curves.curve import CurveLaw
from trackfg.mapping.joining.landmarks import landmarks
from trackfg.maps.feature_map import LANDMARK_COLUMNS

PLACE_SD_M = 0.5
OWN = np.diag([0.15, 0.16, 0.16, 0.15, 5e-7, 0.05]) ** 2
OWN[0, 1] = OWN[1, 0] = OWN[2, 3] = OWN[3, 2] = -0.8 * 0.15 * 0.16


def curve(
    btc: float,
    lengths: tuple[float, float, float] = (60.0, 150.0, 60.0),
    radius_m: float = 400.0,
    law_in: CurveLaw = "clothoid",
    law_out: CurveLaw = "clothoid",
) -> Curve:
    points = btc + np.cumsum([0.0, *lengths])
    return Curve(
        id=0,
        kind="simple",
        sense="left" if radius_m > 0.0 else "right",
        **dict(zip(POINTS, points.tolist(), strict=True)),
        curvature_1pm=1.0 / radius_m,
        cant_mm=60.0,
        law_in=law_in,
        law_out=law_out,
        law_in_probability=1.0,
        law_out_probability=1.0,
        covariance=OWN,
    )


def place_covariance(chainage: np.ndarray) -> np.ndarray:
    """Common to neighbours: it fades over a kilometre."""
    apart = np.abs(chainage[:, None] - chainage)
    return np.asarray(PLACE_SD_M**2 * np.exp(-apart / 1000.0))


def described(curves: list[Curve], previous: pd.DataFrame | None = None) -> tuple[pd.DataFrame, np.ndarray]:
    return landmarks(curves, previous, place_covariance, None, lambda x: np.full(len(x), 3))


def ids(curves: list[Curve], previous: pd.DataFrame) -> list[str]:
    return list(dict.fromkeys(described(curves, previous)[0]["curve_id"]))


# Equal curves in a row, and others between.
LINE = [curve(500.0), curve(1200.0), curve(1900.0, radius_m=-300.0), curve(2600.0), curve(3300.0), curve(4000.0)]
BEFORE = described(LINE)[0]


def test_a_plain_curve_has_four_landmarks_with_its_own_and_the_maps_uncertainty() -> None:
    table, covariance = described([curve(500.0)])
    assert tuple(table.columns) == LANDMARK_COLUMNS
    assert table["landmark_id"].tolist() == ["C0001-BTC", "C0001-BCC", "C0001-ECC", "C0001-ETC"]
    assert table["chainage_m"].tolist() == [500.0, 560.0, 710.0, 770.0]
    np.testing.assert_allclose(covariance, place_covariance(table["chainage_m"].to_numpy()) + OWN[:4, :4])
    np.testing.assert_allclose(table["chainage_m_sd"], np.sqrt(np.diag(covariance)))
    assert table["transition_length_m_sd"].tolist() == pytest.approx(4 * [np.sqrt(0.15**2 + 0.16**2 + 1.6 * 0.024)])
    row = table.iloc[2]
    assert (row["kind"], row["sense"], row["law"], row["radius_m"], row["arc_length_m"], row["cant_mm"]) == (
        "ECC",
        "left",
        "clothoid",
        400.0,
        150.0,
        60.0,
    )
    assert row[["radius_m_sd", "arc_length_m_sd", "cant_mm_sd"]].tolist() == pytest.approx(
        [0.08, 0.22627, 0.05], rel=1e-4
    )
    assert table["observations"].tolist() == [3, 3, 3, 3]
    assert table[["east_m", "up_m_sd"]].isna().all(axis=None)


def test_positions_are_those_that_are_given() -> None:
    def position(chainage: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return np.outer(chainage, [1.0, 2.0, 0.1]), np.full((len(chainage), 3), 0.7)

    table, _ = landmarks([curve(500.0)], None, place_covariance, position, lambda x: np.ones(len(x)))
    assert table.loc[1, ["east_m", "north_m", "up_m", "up_m_sd"]].tolist() == pytest.approx([560.0, 1120.0, 56.0, 0.7])


def test_points_that_coincide_are_one_landmark() -> None:
    first = curve(500.0, (60.0, 150.0, 40.0))
    # Its entry is the exit of the first; the third begins where the second ends; the fourth has no transition.
    second = replace(curve(710.0, (40.0, 100.0, 50.0), 700.0), kind="compound part")
    third = curve(900.0, (60.0, 90.0, 50.0), -500.0)
    fourth = curve(1400.0, (0.0, 80.0, 0.0), law_in="none", law_out="none")
    table, covariance = described([first, second, third, fourth])
    assert table["landmark_id"].str[4:].tolist() == [
        *("1-BTC", "1-BCC", "1-ECC", "2-BCC", "2-ECC", "2-ETC"),
        *("3-BCC", "3-ECC", "3-ETC", "4-BCC", "4-ECC"),
    ]
    assert table["chainage_m"].is_monotonic_increasing
    assert table["transition_length_m"].tolist()[2:4] == [40.0, 40.0]
    assert table.loc[9, "law"] == ""
    assert table.loc[[9, 10], ["transition_length_m", "transition_length_m_sd"]].isna().all(axis=None)
    np.testing.assert_allclose(covariance, covariance.T)
    assert np.linalg.eigvalsh(covariance).min() > 0.0
    own = covariance - place_covariance(table["chainage_m"].to_numpy())
    np.testing.assert_allclose(own[2:4, 2:4], OWN[2:4, 2:4], atol=1e-12)
    np.testing.assert_allclose(own[:9, 9:], 0.0, atol=1e-12)


def test_a_step_between_two_circles_is_the_end_of_the_first() -> None:
    step = [curve(500.0, (60.0, 150.0, 0.0), law_out="none"), curve(710.0, (0.0, 90.0, 50.0), 600.0, law_in="none")]
    assert described(step)[0]["landmark_id"].str[4:].tolist() == ["1-BTC", "1-BCC", "1-ECC", "2-ECC", "2-ETC"]


def test_what_the_profile_does_not_show_is_no_landmark() -> None:
    seen = replace(curve(0.0), btc_m=np.nan, bcc_m=np.nan, law_in="unseen")
    table, _ = described([seen])
    assert table["kind"].tolist() == ["ECC", "ETC"]
    assert table["arc_length_m"].isna().all()


def test_a_line_without_curves_has_none() -> None:
    table, covariance = described([])
    assert tuple(table.columns) == LANDMARK_COLUMNS
    assert table["chainage_m"].dtype == np.float64
    assert covariance.shape == (0, 0)


def test_the_same_curves_have_the_same_ids() -> None:
    assert ids(LINE, BEFORE) == ["C0001", "C0002", "C0003", "C0004", "C0005", "C0006"]
    shifted = [replace(c, **{name: getattr(c, name) + 1.0 for name in POINTS}) for c in LINE]
    assert ids(shifted, BEFORE) == ids(LINE, BEFORE)


@pytest.mark.parametrize("gone", range(6))
def test_a_curve_that_vanishes_does_not_shift_the_rest(gone: int) -> None:
    left = LINE[:gone] + LINE[gone + 1 :]
    assert ids(left, BEFORE) == [f"C{k + 1:04d}" for k in range(6) if k != gone]


def test_a_curve_that_appears_has_a_number_of_its_own() -> None:
    more = [*LINE[:2], curve(1550.0), *LINE[2:]]
    assert ids(more, BEFORE) == ["C0001", "C0002", "C0007", "C0003", "C0004", "C0005", "C0006"]
    # One that went, before, does not give its number away.
    after = described(LINE[1:], BEFORE)[0]
    assert ids(LINE, after) == ["C0007", "C0002", "C0003", "C0004", "C0005", "C0006"]


def test_a_curve_of_another_radius_or_sense_is_another_one() -> None:
    wider = [*LINE[:3], curve(2600.0, radius_m=500.0), *LINE[4:]]
    assert ids(wider, BEFORE)[3] == "C0007"
    turned = [*LINE[:3], curve(2600.0, radius_m=-400.0), *LINE[4:]]
    assert ids(turned, BEFORE)[3] == "C0007"
    renewed = [*LINE[:3], curve(2601.0, (62.0, 148.0, 59.0), 404.0), *LINE[4:]]
    assert ids(renewed, BEFORE) == ids(LINE, BEFORE)


def test_an_uncertain_map_keeps_the_order() -> None:
    """All equal, and the whole map moved by 40 m, within its sigmas."""

    def vague(chainage: np.ndarray) -> np.ndarray:
        return np.full((len(chainage), len(chainage)), 30.0**2) + 1e-6 * np.eye(len(chainage))

    equal = [curve(500.0 + 700.0 * k) for k in range(5)]
    moved = [curve(540.0 + 700.0 * k) for k in range(5)]
    before = landmarks(equal, None, vague, None, lambda x: np.ones(len(x)))[0]
    after = landmarks(moved, before, vague, None, lambda x: np.ones(len(x)))[0]
    assert after["landmark_id"].tolist() == before["landmark_id"].tolist()
