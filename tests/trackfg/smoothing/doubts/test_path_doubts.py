"""A car body that is declared rigid leaves the direction in which it points, whether or not it leans in curves."""

from __future__ import annotations

from collections.abc import Callable

from trackfg.config import SmoothConfig
from trackfg.recording.model import Recording
from trackfg.smoothing.doubts.path_doubts import path_doubts
from trackfg.smoothing.smoother import SmoothedStates, smooth_states


def test_the_geometry_of_a_body_on_springs_that_is_declared_rigid_is_not_trusted(
    smoothed: Callable[..., SmoothedStates], on_springs: Callable[..., tuple[Recording, Recording]]
) -> None:
    """The body does not lean, so that its roll says nothing; the vehicle of the scenario itself is rigid."""
    recording, declared_rigid = on_springs(0.0, seed=1, duration_s=100.0)
    body = smooth_states(declared_rigid, SmoothConfig())
    verdicts = {verdict.quantity: verdict for verdict in body.verdicts}
    for quantity in ("cross_level", "twist", "level", "alignment"):
        assert verdicts[quantity].status == "not_trusted"
        assert any("leaves the direction" in reason for reason in verdicts[quantity].reasons)
    assert not path_doubts(smoothed("mainline", seed=0, duration_s=150.0))
    assert not path_doubts(smooth_states(recording, SmoothConfig()))
