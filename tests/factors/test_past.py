"""The factor that stands for keyframes that are gone."""

from __future__ import annotations

import numpy as np

from trackfg.factors.family import check_jacobians
from trackfg.factors.past import past
from trackfg.factors.states import KEYFRAME_DIM, SHARED, SHARED_DIM, Kind, Nav, States, Step
from trackfg.frames import so3_exp


def one_keyframe(rng: np.random.Generator) -> States:
    nav = Nav(so3_exp(rng.standard_normal((1, 3))), *rng.standard_normal((2, 1, 3)))
    shared = (rng.standard_normal((1, kind.dim)) for kind in SHARED)
    return States(nav, rng.standard_normal((1, Kind.BIAS.dim)), rng.standard_normal((1, Kind.ODO.dim)), *shared)


def moved(states: States, rng: np.random.Generator, size: float) -> tuple[States, np.ndarray]:
    tangent = size * rng.standard_normal(KEYFRAME_DIM + SHARED_DIM)
    return states.moved(Step(tangent[None, :KEYFRAME_DIM], tangent[KEYFRAME_DIM:])), tangent


def test_it_measures_from_where_it_was_linearised() -> None:
    rng = np.random.default_rng(0)
    origin = one_keyframe(rng)
    rows = rng.standard_normal((49, 50))
    states, tangent = moved(origin, rng, 0.3)
    np.testing.assert_allclose(past(rows, origin).residual(states)[0], rows[:, :-1] @ tangent - rows[:, -1], atol=1e-9)
    back = states.away_from(origin)
    np.testing.assert_allclose(np.concatenate([back.keyframes[0], back.shared]), tangent, atol=1e-12)


def test_jacobians() -> None:
    rng = np.random.default_rng(1)
    origin = one_keyframe(rng)
    check_jacobians(past(rng.standard_normal((49, 50)), origin), moved(origin, rng, 0.2)[0], rtol=1e-6, atol=1e-6)
