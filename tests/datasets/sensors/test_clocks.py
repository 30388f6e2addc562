"""Clocks stamp wrongly by as much as asked, in order; rows get lost as often as asked."""

import numpy as np
import pandas as pd
import pytest

from trackfg.datasets.sensors.clocks import ClockModel, DropModel, dropped, stamped


@pytest.fixture
def table():
    t = np.arange(60_000) / 100.0
    return pd.DataFrame({"t_s": t, "distance_m": 3.0 * t})


def test_offset_and_drift_are_what_must_be_added(table):
    stamps = stamped(table, ClockModel(offset_s=0.25, drift=1e-5), np.random.default_rng(0))
    late = table["t_s"] - stamps["t_s"]
    np.testing.assert_allclose(late, 0.25 + 1e-5 * table["t_s"], atol=1e-12)
    assert stamps["distance_m"].equals(table["distance_m"])
    assert stamped(table, ClockModel(), np.random.default_rng(0)).equals(table)


def test_jitter_has_its_sigma_and_keeps_the_order(table):
    before = table.copy()
    jitter = stamped(table, ClockModel(jitter_sd_s=1e-3), np.random.default_rng(0))["t_s"] - table["t_s"]
    assert jitter.std() == pytest.approx(1e-3, rel=0.02)
    assert abs(np.corrcoef(jitter[:-1], jitter[1:])[0, 1]) < 0.02
    wild = stamped(table, ClockModel(jitter_sd_s=0.1, drift=-1e-4), np.random.default_rng(0))["t_s"]
    assert (np.diff(wild) > 0).all()
    irregular = pd.DataFrame({"t_s": np.cumsum(np.random.default_rng(1).exponential(1.0, 5000))})
    assert (np.diff(stamped(irregular, ClockModel(jitter_sd_s=1.0), np.random.default_rng(2))["t_s"]) > 0).all()
    assert table.equals(before)


def test_single_rows_are_lost_with_their_probability(table):
    left = dropped(table, DropModel(probability=0.03), np.random.default_rng(0))
    lost = 1 - len(left) / len(table)
    assert lost == pytest.approx(0.03, abs=0.003)
    assert left["t_s"].isin(table["t_s"]).all()
    assert list(left.index) == list(range(len(left)))


def test_bursts_are_as_many_and_as_long_as_asked(table):
    gaps = []
    for seed in range(40):
        steps = np.diff(
            dropped(table, DropModel(bursts_per_hour=60.0, burst_s=(0.5, 1.5)), np.random.default_rng(seed))["t_s"]
        )
        gaps.append(steps[steps > 0.011])
    # Ten minutes each; a burst takes a second of the time in which others might begin.
    assert np.mean([len(found) for found in gaps]) == pytest.approx(10 / (1 + 1 / 60), rel=0.15)
    lengths = np.concatenate(gaps)
    assert lengths.min() > 0.49
    assert lengths.max() < 1.52
    assert lengths.mean() == pytest.approx(1.01, rel=0.05)


def test_a_seed_repeats_two_differ_and_nothing_is_lost_by_default(table):
    clock, drops = ClockModel(jitter_sd_s=1e-3), DropModel(probability=0.1, bursts_per_hour=30.0)

    def damaged(seed):
        rng = np.random.default_rng(seed)
        return dropped(stamped(table, clock, rng), drops, rng)

    assert damaged(1).equals(damaged(1))
    assert not damaged(1).equals(damaged(2))
    assert dropped(table, DropModel(), np.random.default_rng(0)).equals(table)
    empty = table.iloc[:0]
    assert dropped(stamped(empty, clock, np.random.default_rng(0)), drops, np.random.default_rng(0)).empty
