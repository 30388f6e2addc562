"""Wrong fixes do not move a run: the solution is that of the right ones."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from trackfg.datasets.scenarios import Simulation, scenario, simulate
from trackfg.datasets.sensors.positioning import BaliseModel
from trackfg.recording.model import Recording
from trackfg.results.result import Result
from trackfg.smoothing.smoother import smooth


@pytest.fixture(scope="module")
def run() -> Simulation:
    return simulate(replace(scenario("mainline"), balises=BaliseModel(400.0, 0.3)), seed=1, duration_s=200.0)


def with_fixes(run: Simulation, moved_m: dict[int, float], kept: Sequence[int] | None = None) -> Recording:
    fixes = run.recording.fixes
    assert fixes is not None
    chainage = fixes["chainage_m"].to_numpy().copy()
    for i, by in moved_m.items():
        chainage[i] += by
    table = fixes.assign(chainage_m=chainage)
    return replace(run.recording, fixes=table if kept is None else table.iloc[list(kept)].reset_index(drop=True))


@pytest.mark.parametrize("moved_m", [{0: 900.0}, {3: -800.0, 5: 40.0}])
def test_the_solution_is_that_of_the_right_fixes(run: Simulation, moved_m: dict[int, float]) -> None:
    assert run.recording.fixes is not None
    n = len(run.recording.fixes)
    assert n >= 5 * len(moved_m)
    wrong = smooth(with_fixes(run, moved_m))
    oracle = smooth(with_fixes(run, {}, [i for i in range(n) if i not in moved_m]))
    assert wrong.summary.solver.converged
    off = wrong.trajectory["chainage_m"] - oracle.trajectory["chainage_m"]
    assert (off.abs() < 0.2 * oracle.trajectory["chainage_m_sd"]).all()
    withheld = next(finding for finding in wrong.summary.findings if finding.code == "fixes-withheld")
    assert f"{len(moved_m)} of {n} fixes" in withheld.message
    for by in moved_m.values():
        assert any(f"({by + r / 10:+.1f} m)" in withheld.message for r in range(-20, 21))
    aside = wrong.events[wrong.events["kind"] == "fix set aside"]
    np.testing.assert_allclose(aside["start_s"], run.recording.fixes["t_s"].iloc[list(moved_m)], atol=0.02)


def test_right_fixes_stay(run: Simulation) -> None:
    result = smooth(run.recording)
    assert not any(finding.code == "fixes-withheld" for finding in result.summary.findings)
    assert set(result.events["kind"]).isdisjoint({"fix set aside"})


@pytest.fixture(scope="module")
def against_the_direction(run: Simulation) -> Result:
    """Of the run whose description has the wrong direction."""
    description = run.recording.description
    track = description.track.model_copy(update={"direction": -description.track.direction})
    return smooth(replace(run.recording, description=description.model_copy(update={"track": track})))


def test_fixes_that_all_contradict_each_other_are_not_counted_as_places(
    run: Simulation, against_the_direction: Result
) -> None:
    """With the wrong direction every fix is right by itself only."""
    assert run.recording.fixes is not None
    verdicts = {verdict.quantity: verdict for verdict in against_the_direction.summary.verdicts}
    chainage = verdicts["chainage"]
    assert chainage.status == "not_trusted"
    (hint,) = (
        hint
        for reason, hint in zip(chainage.reasons, chainage.hints, strict=True)
        if reason.startswith(f"no two of {len(run.recording.fixes)} fixes")
    )
    assert "check track.direction" in hint


def test_geometry_that_fixes_show_to_be_seen_from_the_wrong_end_is_not_trusted(against_the_direction: Result) -> None:
    """Left is right then, and up is down: the sigmas of a geometry that is mirrored say nothing."""
    verdicts = {verdict.quantity: verdict for verdict in against_the_direction.summary.verdicts}
    for quantity in ("cross_level", "twist", "level", "alignment", "curvature", "gradient"):
        assert verdicts[quantity].status == "not_trusted"
        assert any("set track.direction = 1" in hint for hint in verdicts[quantity].hints)


def chainage_reasons(result: Result) -> tuple[str, ...]:
    return next(verdict.reasons for verdict in result.summary.verdicts if verdict.quantity == "chainage")


def test_a_jump_of_the_kilometrage_is_not_settled_by_numbers() -> None:
    """The last third of the fixes is 60 m further, and GNSS shows that the vehicle was not."""
    plan = replace(scenario("mainline-gnss"), balises=BaliseModel(400.0, 0.3))
    run = simulate(plan, seed=1, duration_s=200.0)
    assert run.recording.fixes is not None
    n = len(run.recording.fixes)
    behind = range(n - n // 3, n)
    assert len(behind) >= 2
    first_s, last_s = run.recording.fixes["t_s"].iloc[[behind[0], n - 1]]
    reasons = chainage_reasons(smooth(with_fixes(run, dict.fromkeys(behind, 60.0))))
    assert any(reason.startswith(f"all fixes at {first_s:.0f}-{last_s:.0f} s are +") for reason in reasons)
    assert not any(reason.startswith("all fixes at") for reason in chainage_reasons(smooth(run.recording)))
