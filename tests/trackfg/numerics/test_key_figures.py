"""Recordings, results, maps and comparisons show themselves in a line and in a notebook."""

from __future__ import annotations

from trackfg.datasets.scenarios import simulate
from trackfg.numerics.key_figures import KeyFigures
from trackfg.smoothing.smoother import smooth


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
