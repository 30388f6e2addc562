"""Faults take out what they say and nothing else."""

from trackfg import datasets


def test_dropped_spans_are_gone():
    recording = datasets.simulate("mainline", duration_s=60.0).recording
    damaged = datasets.drop_tach(datasets.drop_imu(recording, 40.0, 45.0), 20.0, 50.0)
    assert not damaged.imu["t_s"].between(40.0, 44.999).any()
    assert not damaged.tach["t_s"].between(20.0, 49.999).any()
    assert len(damaged.imu) == len(recording.imu) - 5 * 200
    assert len(damaged.tach) == len(recording.tach) - 30 * 50
    assert damaged.tach["distance_m"].iloc[-1] == recording.tach["distance_m"].iloc[-1]
    assert len(recording.imu) == 60 * 200
