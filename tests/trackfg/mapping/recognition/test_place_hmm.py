"""The hidden Markov model: its backward step is the transpose of its forward step, and it says where a run is."""

from __future__ import annotations

import numpy as np
import pytest

from trackfg.mapping.recognition.place_hmm import NEAR, Message, PlaceHmm, PlaceWindows

PLACES = 90


def chain(first: list[int], scale_sd: float, short: np.ndarray | None = None) -> PlaceHmm:
    """Sections of 40 m, each with a window of 90 places (180 m); nothing is known of curves."""
    k = len(first)
    windows = PlaceWindows(np.array(first), np.full(k, PLACES), 40.0 * np.arange(k))
    nothing = np.zeros((k, PLACES), dtype=np.float32)
    return PlaceHmm(windows, list(nothing if short is None else short.astype(np.float32)), list(nothing), scale_sd)


@pytest.mark.parametrize("scale_sd", [1e-5, 0.01])
@pytest.mark.parametrize("first", [[0, 20], [0, 0], [0, 71]])
def test_backward_is_the_transpose_of_forward(first: list[int], scale_sd: float) -> None:
    model = chain(first, scale_sd)
    rng = np.random.default_rng(1)

    def drawn(place: int) -> Message:
        on = rng.random((2, len(model.scales), PLACES)).astype(np.float32)
        return Message(place, on, rng.random(PLACES).astype(np.float32), float(rng.random()))

    def product(a: Message, b: Message) -> float:
        return float((a.on * b.on).sum() + (a.alike * b.alike).sum()) + a.off * b.off

    now, future, other = drawn(first[0]), drawn(first[1]), drawn(first[0])
    ahead, back = model._predict(1, now), model._predict_back(1, now, future)
    # The transpose is scaled by its greatest value, the same for all states of the section.
    ratio = product(ahead, future) / product(now, back)
    assert product(model._predict(1, other), future) == pytest.approx(ratio * product(other, back), rel=1e-4)


def test_probability_is_kept() -> None:
    model = chain([0, 20, 40], 0.01)
    state = model._prior()
    for k in (1, 2):
        state = model._predict(k, state)
        total = float(state.on.sum() + state.alike.sum()) + state.off
        # All but what slips over an end of the window.
        assert 0.999 < total <= 1.0 + 1e-5


def test_a_few_sections_that_fit_place_the_run() -> None:
    short = np.full((6, PLACES), -5.0)
    for k in range(6):
        short[k, 30 + k] = 15.0  # one place further each time than the windows: creep
    straight = np.full((6, PLACES), -5.0)
    straight[:, 30] = 15.0
    places = chain([20 * k for k in range(6)], 1e-5, straight).posterior()
    assert places.mode.tolist() == [30 + 20 * k for k in range(6)]
    assert np.all(places.near[:, NEAR] > 0.99)
    assert np.all(np.diff(places.so_far[:, NEAR]) > -1e-3)
    assert np.all(places.unchanged > 0.99)
    creeping = chain([20 * k for k in range(6)], 1e-5, short).posterior()
    assert creeping.mode.tolist() == [30 + 21 * k for k in range(6)]


def test_one_wrong_section_is_no_jump() -> None:
    short = np.full((7, PLACES), -5.0)
    short[:, 30] = 15.0
    short[3] = -12.0
    short[3, 60] = 12.0  # looks like another place, 60 m away
    places = chain([20 * k for k in range(7)], 1e-5, short).posterior()
    assert places.mode.tolist() == [30 + 20 * k for k in range(7)]
    assert places.unchanged[3] < 0.5


def test_nothing_known_is_nothing_found() -> None:
    places = chain([20 * k for k in range(5)], 1e-5).posterior()
    assert np.all(places.near.max(axis=1) < 0.05)
