"""The Allan deviations of a sensor at rest over the averaging time, measured and as its kinds of noise make them."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd

from trackfg.files.atomic_file import replaced_file
from trackfg.plots.draw import picture_path
from trackfg.plots.sheet import BLUE, GREY, ORANGE

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_COLOURS = {"x": BLUE, "y": ORANGE, "z": "#3b8a63"}
"""Colours of the axes, which are dashed differently too."""

_DASHES = {"x": "solid", "y": "dash", "z": "dot"}
_PANELS = (("gyro", "Allan deviation of rate, rad/s"), ("accel", "Allan deviation of specific force, m/s²"))


def plot_allan(allan: pd.DataFrame, path: str | os.PathLike[str], *, title: str) -> Path:
    """Draw Allan deviations into a ``.png``, ``.svg`` or ``.html`` file and return its path.

    ``allan`` has the columns ``sensor, axis, tau_s, deviation, low, high, model`` as
    :class:`trackfg.sensors.log_noise.LogNoise` has. Raises :class:`~trackfg.errors.BadInputError` for another suffix.
    """
    target = picture_path(path)
    with replaced_file(target) as new:
        if target.suffix == ".html":
            _page(allan, title).write_html(new, include_plotlyjs=True, div_id="trackfg", config={"displaylogo": False})
        else:
            _figure(allan, title).savefig(new, dpi=140, metadata={"Date": None} if target.suffix == ".svg" else None)
    return target


def _figure(allan: pd.DataFrame, title: str) -> Figure:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11.0, 5.2), layout="constrained")
    figure.suptitle(title, x=0.01, ha="left", fontsize=12, fontweight="bold")
    dashes = {"solid": "-", "dash": "--", "dot": ":"}
    for axes, (sensor, label) in zip(figure.subplots(1, 2), _PANELS, strict=True):
        for axis, curve in allan[allan["sensor"] == sensor].groupby("axis"):
            colour = _COLOURS[str(axis)]
            axes.fill_between(curve["tau_s"], curve["low"], curve["high"], color=colour, alpha=0.18, linewidth=0)
            axes.plot(curve["tau_s"], curve["deviation"], dashes[_DASHES[str(axis)]], color=colour, label=f"{axis}")
            axes.plot(curve["tau_s"], curve["model"], color=GREY, linewidth=0.8, zorder=1)
        axes.plot([], [], color=GREY, linewidth=0.8, label="kinds of noise")
        axes.set(xscale="log", yscale="log", xlabel="averaging time, s", ylabel=label)
        axes.grid(visible=True, which="major", color="#e5e7eb")
        axes.legend(frameon=False)
    return figure


def _page(allan: pd.DataFrame, title: str) -> Any:
    from plotly.subplots import make_subplots

    figure = make_subplots(rows=1, cols=2, horizontal_spacing=0.1)
    for column, (sensor, label) in enumerate(_PANELS, start=1):
        for axis, curve in allan[allan["sensor"] == sensor].groupby("axis"):
            colour, first = _COLOURS[str(axis)], column == 1
            tau = curve["tau_s"].tolist()
            band = {"x": tau + tau[::-1], "y": curve["high"].tolist() + curve["low"].tolist()[::-1]}
            figure.add_scatter(
                **band, fill="toself", fillcolor=colour, opacity=0.18, line_width=0, hoverinfo="skip",
                showlegend=False, row=1, col=column,
            )  # fmt: skip
            figure.add_scatter(
                x=tau, y=curve["deviation"].tolist(), name=str(axis), legendgroup=str(axis), showlegend=first,
                line={"color": colour, "dash": _DASHES[str(axis)]}, row=1, col=column,
            )  # fmt: skip
            figure.add_scatter(
                x=tau, y=curve["model"].tolist(), name=f"{axis}: kinds of noise", legendgroup="model",
                line={"color": GREY, "width": 1}, showlegend=first and axis == "x", row=1, col=column,
            )  # fmt: skip
        figure.update_xaxes(title_text="averaging time, s", row=1, col=column)
        figure.update_yaxes(title_text=label, row=1, col=column)
    figure.update_xaxes(type="log", dtick=1, exponentformat="power")
    figure.update_yaxes(type="log", dtick=1, exponentformat="power")
    figure.update_layout(title=title, template="plotly_white", hovermode="x")
    return figure
