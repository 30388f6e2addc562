from __future__ import annotations

import numpy as np

from trackfg.numerics.spans import true_runs, true_stretches


def test_runs_near_each_other_are_one_stretch() -> None:
    mask = np.array([0, 1, 1, 0, 0, 1, 0, 0, 0, 1], dtype=bool)
    assert true_stretches(mask, 3).tolist() == [[1, 6], [9, 10]]
    assert true_stretches(mask, 1).tolist() == true_runs(mask).tolist()
    assert true_stretches(mask, 4).tolist() == [[1, 10]]
    assert len(true_stretches(~mask & mask, 3)) == 0
