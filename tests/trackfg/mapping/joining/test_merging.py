from __future__ import annotations

import numpy as np
import pandas as pd

from trackfg.mapping.joining.merging import MERGED, merged, window_means


def table(first: int, last: int, value: float, sd: float) -> pd.DataFrame:
    x = np.arange(first, last + 1) * 0.25
    columns: dict[str, object] = {"chainage_m": x}
    for name in MERGED:
        columns |= {name: np.full(len(x), value), f"{name}_sd": np.full(len(x), sd)}
    return pd.DataFrame({**columns, "observations": np.ones(len(x), dtype=np.int64)})


def test_means_are_weighted_by_inverse_variances() -> None:
    both = merged(table(0, 99, 1.0, 0.1), table(50, 149, 2.0, 0.2))
    assert len(both) == 150
    middle = both[both["observations"] == 2]
    assert len(middle) == 50
    np.testing.assert_allclose(middle["versine_level_mm"], (100.0 + 50.0) / 125.0)
    np.testing.assert_allclose(middle["versine_level_mm_sd"], 125.0**-0.5)
    np.testing.assert_allclose(both["gradient_permille"].iloc[[0, -1]], [1.0, 2.0])


def test_order_does_not_matter() -> None:
    rng = np.random.default_rng(2)
    tables = [table(k, 100 + k, float(rng.normal()), float(rng.uniform(0.1, 1.0))) for k in range(3)]
    one = merged(merged(tables[0], tables[1]), tables[2])
    other = merged(tables[2], merged(tables[1], tables[0]))
    pd.testing.assert_frame_equal(one, other)


def test_unknown_values_have_no_weight() -> None:
    run = table(0, 99, 5.0, 0.1)
    run.loc[10:20, "curvature_1pm"] = np.nan
    both = merged(table(0, 99, 1.0, 0.1), run)
    np.testing.assert_allclose(both["curvature_1pm"].iloc[10:21], 1.0)
    np.testing.assert_allclose(both["curvature_1pm"].iloc[21:], 3.0)


def test_a_gap_between_two_stretches_stays() -> None:
    both = merged(table(0, 99, 1.0, 0.1), table(200, 299, 1.0, 0.1))
    assert len(both) == 200
    assert both["chainage_m"].diff().max() == 25.25


def test_window_means_need_half_the_window() -> None:
    run = table(0, 799, 1.0, 0.1)
    run["cross_level_mm"] = run["chainage_m"]
    means = window_means(run, "cross_level_mm", np.array([0.0, 100.0, 260.0]), 100.0)
    assert abs(means[0] - 24.9) < 0.2
    assert abs(means[1] - 100.0) < 0.2
    assert np.isnan(means[2])
