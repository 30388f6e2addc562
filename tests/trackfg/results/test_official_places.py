"""Chainages that are not those of a kilometrage."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from trackfg.recording.line_kilometrage import LineKilometrage
from trackfg.results.official_places import unplaced


@pytest.mark.parametrize(
    ("begin_m", "end_m", "said"),
    [
        (0.0, None, None),
        (4000.0, None, None),
        (12000.0, 16000.0, "0 to 3000 m, but [kilometrage] begins at 12000 m"),
        (-9000.0, -8000.0, "0 to 3000 m, but [kilometrage] ends at -8000 m"),
    ],
)
def test_a_run_outside_of_its_kilometrage_is_named(begin_m: float, end_m: float | None, said: str | None) -> None:
    equation = [{"chainage_m": begin_m, "km": "85+000"}]
    given = LineKilometrage.model_validate({"equation": equation, "end_chainage_m": end_m})
    messages = [finding.message for finding in unplaced(pd.Series(np.linspace(0.0, 3000.0, 9)), given)]
    assert len(messages) == (said is not None)
    assert all(str(said) in message for message in messages)
