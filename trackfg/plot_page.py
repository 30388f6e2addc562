"""Draw a :class:`trackfg.plot_sheet.Sheet` as one self-contained page, with plotly; opening it needs no network."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import plotly.graph_objects as go
from numpy.typing import NDArray
from plotly.subplots import make_subplots

from trackfg.frames import Array
from trackfg.plot_sheet import AMBER, SPAN_NAME, Curve, Sheet

_PANEL_SHARE, _GAP = 0.5, 0.07
_LEGEND = {"orientation": "h", "xanchor": "left"}


def write(sheet: Sheet, path: Path) -> None:
    """Draw ``sheet`` into ``path``."""
    rows = len(sheet.panels)
    figure = make_subplots(
        rows=rows,
        cols=2,
        column_widths=[1.0 - _GAP - _PANEL_SHARE, _PANEL_SHARE],
        horizontal_spacing=_GAP,
        vertical_spacing=0.07,
        shared_xaxes="columns",
        specs=[[{"rowspan": rows}, {}], *([[None, {}]] * (rows - 1))],
    )
    _map(figure, sheet)
    for row, panel in enumerate(sheet.panels, start=1):
        legend = f"legend{row + 1}"
        for curve in panel.curves:
            for trace in _traces(curve):
                figure.add_trace(trace.update(legend=legend), row=row, col=2)
        scale = {"type": "log", "dtick": 1} if panel.log else {}
        figure.update_yaxes(title_text=panel.label, **scale, row=row, col=2)
        axis = next(figure.select_yaxes(row=row, col=2))
        figure.update_layout({legend: _LEGEND | {"x": 1.0 - _PANEL_SHARE, "y": axis.domain[1], "yanchor": "bottom"}})
        for start, end in sheet.spans:
            figure.add_vrect(start, end, fillcolor=AMBER, opacity=0.25, line_width=0, layer="below", row=row, col=2)
    ends = [curve.t_s[[0, -1]] for panel in sheet.panels for curve in panel.curves]
    figure.update_xaxes(range=[np.min(ends), np.max(ends)], col=2)
    figure.update_xaxes(title_text="time, s", row=rows, col=2)
    figure.update_layout(
        title={"text": sheet.title, "x": 0.01, "font": {"size": 20}},
        template="plotly_white",
        font={"family": "system-ui, sans-serif", "size": 13},
        legend=_LEGEND | {"x": 0.0, "y": 1.0, "yanchor": "bottom"},
        margin={"l": 70, "r": 20, "t": 90, "b": 60},
        hoverlabel={"namelength": -1},
    )
    figure.write_html(
        path,
        include_plotlyjs=True,
        default_height="calc(100vh - 32px)",
        div_id="trackfg",  # a fixed one, so that the same sheet gives the same page
        config={"displaylogo": False, "responsive": True},
    )


def _map(figure: go.Figure, sheet: Sheet) -> None:
    seen: set[str] = set()
    wide_first = sorted(sheet.paths, key=lambda line: line.name != SPAN_NAME)
    for line in wide_first:
        wide = line.name == SPAN_NAME
        style = {"marker": {"color": line.colour, "size": 4}} if line.dots else {}
        if not line.dots:
            style = {"line": {"color": line.colour, "width": 9 if wide else 2}}
        figure.add_trace(
            go.Scatter(
                x=_small(line.east_m),
                y=_small(line.north_m),
                mode="markers" if line.dots else "lines",
                name=line.name,
                legendgroup=line.name,
                showlegend=line.name not in seen,
                hovertemplate="east %{x:.1f} m<br>north %{y:.1f} m",
                **style,
            ),
            row=1,
            col=1,
        )
        seen.add(line.name)
    figure.update_xaxes(title_text="east, m", row=1, col=1)
    figure.update_yaxes(title_text="north, m", scaleanchor="x", scaleratio=1, row=1, col=1)


def _traces(curve: Curve) -> list[go.Scatter]:
    t = _small(curve.t_s)
    hover = "%{x:.1f} s: %{y:.4g}"
    if curve.dots:
        marker = {"color": curve.colour, "size": 4}
        return [go.Scatter(x=t, y=_small(curve.y), mode="markers", name=curve.name, marker=marker, hovertemplate=hover)]
    line = {"color": curve.colour, "width": 1.5}
    traces = [go.Scatter(x=t, y=_small(curve.y), mode="lines", name=curve.name, line=line, hovertemplate=hover)]
    if curve.half_band is not None:
        traces.append(
            go.Scatter(
                x=np.concatenate([t, t[::-1]]),
                y=_small(np.concatenate([curve.y + curve.half_band, (curve.y - curve.half_band)[::-1]])),
                mode="lines",
                line={"width": 0},
                fill="toself",
                fillcolor=_translucent(curve.colour),
                hoverinfo="skip",
                showlegend=False,
            )
        )
    return traces


def _small(values: Array) -> NDArray[np.float32]:
    """Seven digits: what a screen cannot tell from more, in half the bytes."""
    return values.astype(np.float32)


def _translucent(colour: str) -> str:
    red, green, blue = (int(colour[i : i + 2], 16) for i in (1, 3, 5))
    return f"rgba({red},{green},{blue},0.25)"
