"""Recordings, results, maps and comparisons show themselves in a line and in a notebook."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from typing import Any

from trackfg.config import SmoothConfig
from trackfg.datasets import scenarios, simulate
from trackfg.graph import build_problem
from trackfg.numerics.key_figures import KeyFigures
from trackfg.smoothing.smoother import smooth
from trackfg.solver import posterior_covariance, solve


class Named(KeyFigures):
    def key_figures(self) -> dict[str, str]:
        return {"name": "a <b>\x1b[1m", "length": "3 s"}


def test_names_are_text() -> None:
    assert repr(Named()) == "<Named a <b>\\x1b[1m: 3 s>"
    assert '<td style="text-align:left">a &lt;b&gt;' in Named()._repr_html_()


def test_a_recording_and_its_result_are_short() -> None:
    recording = simulate("trolley", seed=0, duration_s=20.0).recording
    shown = repr(recording)
    assert shown.startswith("<Recording trolley-seed0-run0: 20.0 s, imu ")
    assert len(shown) < 200
    result = smooth(recording)
    assert repr(result).startswith("<Result trolley-seed0-run0: 20.0 s, ")
    assert len(repr(result)) < 400
    for one in (recording, result):
        html = one._repr_html_()
        assert html.count("<tr>") == len(one.key_figures())
        assert len(html) < 3000


def _within(value: Any) -> Iterator[Any]:
    """The dataclasses that an object holds, itself included, one of each class."""
    waiting, kinds = [value], set()
    while waiting:
        one = waiting.pop()
        if isinstance(one, dict):
            waiting.extend(one.values())
        elif isinstance(one, tuple | list):
            waiting.extend(one)
        elif is_dataclass(one) and type(one) not in kinds:
            kinds.add(type(one))
            yield one
            waiting.extend(getattr(one, field.name) for field in fields(one))


def test_what_the_documented_functions_return_is_short_down_to_its_parts() -> None:
    simulation = simulate("mainline-gnss", seed=2, duration_s=30.0)
    config = SmoothConfig()
    problem = build_problem(simulation.recording, config)
    solution = solve(problem, config.solver)
    export = problem.to_gtsam(solution.states)
    result = smooth(simulation.recording)
    returned = (simulation, scenarios(), problem, solution, posterior_covariance(solution.root), export, result)
    shown = {type(one): repr(one) for one in _within(returned)}
    assert len(shown) > 30
    for kind, text in {**shown, type(result.summary): str(result.summary)}.items():
        assert text.count("\n") < 10, kind
        assert len(text) < 1500, kind
    assert shown[type(problem)].startswith("<Problem ")
    assert f"{len(problem.measured)} inertial, " in shown[type(problem)]
    assert shown[type(solution)].startswith("<Solution converged: the cost ")
    assert f"R=ndarray {solution.states.nav.R.shape}" in shown[type(solution.states.nav)]
