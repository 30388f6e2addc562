"""A recording in memory knows its measurements by their digest."""

from __future__ import annotations

import hashlib
from dataclasses import replace

from trackfg.datasets.scenarios import simulate


def test_the_digest_is_that_of_all_samples_and_counts_in_succession() -> None:
    recording = simulate("parked", duration_s=60.0).recording
    assert recording.tach is not None
    content = b"".join(table.to_numpy(dtype="<f8").tobytes() for table in (recording.imu, recording.tach))
    assert recording.content_sha256() == hashlib.sha256(content).hexdigest()
    assert replace(recording, tach=None).content_sha256() != recording.content_sha256()
