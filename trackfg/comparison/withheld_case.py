"""One run of a recording without a part of its measurements, and the scores of what predicts that part."""

from __future__ import annotations

from collections.abc import Mapping

from trackfg.comparison.case import (
    Case,
    CaseRun,
    Progress,
    joined,
    largest_distance_km,
    run_all,
    score_table,
    with_first_column,
)
from trackfg.comparison.estimators import Estimator, estimators, with_own
from trackfg.comparison.withholding import FOLDS, division, predicted
from trackfg.evaluation.scores import score_run
from trackfg.io.reader import read_recording


def run_withheld_case(case: Case, *, peers: bool, show: Progress, own: Mapping[str, Estimator]) -> CaseRun:
    """Run every estimator of distance and position, other packages with ``peers`` and a user's ``own``, without the
    withheld measurements.

    Its scores are those of its predictions of them.
    """
    assert case.withheld is not None
    recording = read_recording(case.folder)
    divided = division(recording, case.withheld, case.seed)
    every = with_own(estimators(peers=peers), own)
    catalogue = {name: estimator for name, estimator in every.items() if "distance and position" in estimator.tasks}
    estimates, seconds, left_out = run_all(
        {name: estimator.run for name, estimator in catalogue.items()}, divided.kept, show
    )
    scores = joined(
        with_first_column(
            "estimator",
            name,
            score_run(predicted(divided, recording, estimate, anchored=catalogue[name].anchored), band_kmh=None),
        )
        for name, estimate in estimates.items()
    )
    km = largest_distance_km(estimate.trajectory for estimate in estimates.values())
    clock = recording.imu["t_s"].to_numpy()
    summary = f"{case.withheld} of a recording in {case.folder.name}, in {FOLDS} parts in turn"
    table = score_table(case, scores, seconds, km) if len(scores) else scores
    return CaseRun(case, summary, float(clock[-1] - clock[0]), km, "withheld", seconds, left_out, table)
