"""Draw a :class:`trackfg.plots.sheet.Sheet` as one self-contained page, with plotly; opening it needs no network."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import plotly.graph_objects as go
from numpy.typing import NDArray

from trackfg.numerics.arrays import Array
from trackfg.numerics.spans import true_runs
from trackfg.plots.sheet import AMBER, BAND, GREY, RED, SPAN_NAME, Panel, Sheet, SheetCurve, limit_labels

_LEGEND = {"orientation": "h", "xanchor": "left", "bgcolor": "rgba(0,0,0,0)"}
_MAP_SHARE, _GAP = 0.43, 0.07
_STRIP_PX, _MARGIN_PX, _LABELS_PX = 62, 160, 138
_BESIDE_MAP_PX = 165
"""Height of a panel beside a map, px: room for its turned label and, above it, its legend."""
_LEAST_PX = 480
"""Height of a figure of few panels, px."""


def write(sheet: Sheet, path: Path) -> None:
    """Draw ``sheet`` into ``path``; the same sheet gives the same file."""
    figure = _figure(sheet)
    height = "calc(100vh - 32px)" if sheet.paths else f"max(calc(100vh - 32px), {_height_px(sheet):.0f}px)"
    figure.write_html(
        path,
        include_plotlyjs=True,
        default_height=height,
        div_id="trackfg",  # a fixed one, so that the same sheet gives the same page
        config={"displaylogo": False, "responsive": True},
    )


def notebook_figure(sheet: Sheet) -> go.Figure:
    """Return ``sheet`` as a figure that a notebook shows, as high as its panels need."""
    figure = _figure(sheet)
    figure.update_layout(height=_height_px(sheet))
    return figure


def _height_px(sheet: Sheet) -> float:
    shares = sum(panel.share for panel in sheet.panels)
    return max((_BESIDE_MAP_PX if sheet.paths else _STRIP_PX) * shares + _MARGIN_PX, _LEAST_PX)


def _figure(sheet: Sheet) -> go.Figure:
    figure = go.Figure()
    figure.update_layout(
        title={"text": sheet.title, "x": 0.01, "font": {"size": 20}},
        template="plotly_white",
        font={"family": "system-ui, sans-serif", "size": 13},
        hoverlabel={"namelength": -1},
    )
    if sheet.paths:
        _with_map(figure, sheet)
    else:
        _strips(figure, sheet)
    return figure


def _with_map(figure: go.Figure, sheet: Sheet) -> None:
    left = _MAP_SHARE + _GAP
    _panels(figure, sheet, left, gap=0.07)
    for number, panel in enumerate(sheet.panels, start=1):
        axis = figure.layout[f"yaxis{number}"]
        axis.title = {"text": panel.label}
        legend = _LEGEND | {"x": left, "y": axis.domain[1], "yanchor": "bottom"}
        figure.update_layout({f"legend{number + 1}": legend})
        figure.update_traces(legend=f"legend{number + 1}", selector={"yaxis": _ref(number)})
    _map(figure, sheet, len(sheet.panels) + 1)
    figure.update_layout(
        legend=_LEGEND | {"x": 0.0, "y": 1.0, "yanchor": "bottom"}, margin={"l": 70, "r": 20, "t": 90, "b": 60}
    )


def _strips(figure: go.Figure, sheet: Sheet) -> None:
    """Draw strips with one hover for all panels, labels that can be read without turning the head, limits named at the
    right.
    """
    _panels(figure, sheet, left=0.0, gap=0.012)
    for number, panel in enumerate(sheet.panels, start=1):
        low, high = figure.layout[f"yaxis{number}"].domain
        over = [] if panel.over is None else [panel.over]
        text = "<br>".join(
            f'<span style="color:{drawn.curves[0].colour}">{drawn.label.replace(chr(10), "<br>")}</span>'
            for drawn in (panel, *over)
        )
        _note(
            figure,
            text,
            x=0.0,
            y=(low + high) / 2.0,
            xshift=-_LABELS_PX,
            xanchor="left",
            yanchor="middle",
            align="left",
        )
        for height, label in limit_labels(panel):
            y = low + height * (high - low)
            _note(
                figure, label, x=1.0, y=y, xshift=4, xanchor="left", yanchor="middle", font={"size": 10, "color": RED}
            )
        for x, label in panel.marks:
            _note(figure, label, x=x, xref="x", y=high, xanchor="center", yanchor="top", font={"size": 11})
        for axis in filter(None, (number, panel.over and len(sheet.panels) + number)):
            figure.update_layout({f"yaxis{axis}": {"nticks": 5 if panel.share <= 1.0 else 7, "tickfont": {"size": 10}}})
    footer = sheet.footer.replace("\n", "<br>")
    style = {"size": 11, "color": GREY}
    _note(
        figure,
        footer,
        x=0.0,
        y=0.0,
        xshift=-_LABELS_PX,
        yshift=-45,
        xanchor="left",
        yanchor="top",
        align="left",
        font=style,
    )
    figure.update_xaxes(showspikes=True, spikemode="across", spikethickness=1, spikedash="solid", spikecolor=GREY)
    figure.update_layout(
        showlegend=False,
        hovermode="x unified",
        hoversubplots="axis",
        margin={"l": _LABELS_PX + 15, "r": 120, "t": 55, "b": _MARGIN_PX - 55},
    )


def _note(figure: go.Figure, text: str, **place: Any) -> None:
    figure.add_annotation(**{"text": text, "xref": "paper", "yref": "paper", "showarrow": False} | place)


def _panels(figure: go.Figure, sheet: Sheet, left: float, gap: float) -> None:
    """Draw the panels from top to bottom, right of ``left``, on one horizontal axis; panel 1 is the axis ``yaxis1``.

    What is drawn over panel ``i`` has the axis ``i`` + the number of panels.
    """
    rows = len(sheet.panels)
    unit = (1.0 - gap * (rows - 1)) / sum(panel.share for panel in sheet.panels)
    top = 1.0
    for number, panel in enumerate(sheet.panels, start=1):
        domain = [max(top - unit * panel.share, 0.0), top]
        top = domain[0] - gap
        figure.update_layout({f"yaxis{number}": {"domain": domain, "anchor": "x"} | _scale(panel)})
        _draw(figure, panel, number)
        if panel.over is not None:
            over = {"overlaying": _ref(number), "side": "right", "anchor": "x", "showgrid": False, "tickmode": "auto"}
            figure.update_layout({f"yaxis{rows + number}": over | _scale(panel.over)})
            _draw(figure, panel.over, rows + number)
        if panel.base is not None:
            line = {"color": GREY, "width": 1}
            figure.add_shape(
                type="line",
                x0=0.0,
                x1=1.0,
                xref="x domain",
                y0=panel.base,
                y1=panel.base,
                yref=_ref(number),
                line=line,
                layer="below",
            )
        for start, end in sheet.spans:
            figure.add_shape(
                type="rect", x0=start, x1=end, y0=0.0, y1=1.0, xref="x", yref=f"{_ref(number)} domain",
                fillcolor=AMBER, opacity=0.25, line_width=0, layer="below",
            )  # fmt: skip
    figure.update_layout(
        xaxis={
            "domain": [left, 1.0],
            "anchor": _ref(rows),
            "range": sheet.x_range,
            "title": {"text": sheet.x_label},
            "exponentformat": "none",
            "zeroline": False,
        }
    )


def _ref(number: int) -> str:
    return "y" if number == 1 else f"y{number}"


def _scale(panel: Panel) -> dict[str, Any]:
    if panel.log:
        return {"type": "log", "dtick": 1, "exponentformat": "none"}
    return {"range": panel.y_range, "zeroline": False, "exponentformat": "none"}


def _draw(figure: go.Figure, panel: Panel, number: int) -> None:
    traces = [trace for curve in panel.curves for trace in _traces(curve)]
    dashed = {"color": RED, "width": 1.2, "dash": "dash"}
    traces += [
        go.Scatter(x=_small(limit.x), y=_small(limit.y), mode="lines", line=dashed, hoverinfo="skip", showlegend=False)
        for limit in panel.limits
    ]
    for trace in traces:
        figure.add_trace(trace.update(xaxis="x", yaxis=_ref(number)))


def _map(figure: go.Figure, sheet: Sheet, number: int) -> None:
    labels: set[str] = set()
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
                showlegend=line.name not in labels,
                hovertemplate="east %{x:.1f} m<br>north %{y:.1f} m",
                xaxis="x2",
                yaxis=_ref(number),
                **style,
            )
        )
        labels.add(line.name)
    axis = {"title": {"text": "north, m"}, "scaleanchor": "x2", "scaleratio": 1, "anchor": "x2"}
    figure.update_layout(
        {
            "xaxis2": {"title": {"text": "east, m"}, "domain": [0.0, _MAP_SHARE], "anchor": _ref(number)},
            f"yaxis{number}": axis,
        }
    )


def _traces(curve: SheetCurve) -> list[go.Scatter]:
    x, y = _small(curve.x), _small(curve.y)
    hover = f"{curve.name} %{{y:.4~g}} {curve.unit}"
    more: dict[str, Any] = {}
    if curve.half_band is not None:
        more["customdata"] = _small(curve.half_band / BAND)
        hover += ", sigma %{customdata:.2~g}"
    if curve.notes:
        more["text"] = curve.notes
        hover += ", %{text}"
    hover += ", at %{x:.7~g}<extra></extra>"  # a thinned curve is asked at its own nearest point
    if curve.dots:
        marker = {"color": curve.colour, "size": 4}
        return [go.Scatter(x=x, y=y, mode="markers", name=curve.name, marker=marker, hovertemplate=hover)]
    line = {"color": curve.colour, "width": 1.5}
    traces = [go.Scatter(x=x, y=y, mode="lines", name=curve.name, line=line, hovertemplate=hover, **more)]
    if curve.half_band is not None:
        across, along = _outline(curve)
        traces.append(
            go.Scatter(
                x=_small(across),
                y=_small(along),
                mode="lines",
                line={"width": 0},
                fill="toself",
                fillcolor=_translucent(curve.colour),
                hoverinfo="skip",
                showlegend=False,
            )
        )
    return traces


def _outline(curve: SheetCurve) -> tuple[Array, Array]:
    """Return the outline of the band, there and back; one closed line for each stretch without NaN, and NaN between
    them.
    """
    assert curve.half_band is not None
    low, high = curve.y - curve.half_band, curve.y + curve.half_band
    x, y = [np.empty(0)], [np.empty(0)]
    for start, end in true_runs(np.isfinite(low)):
        run = slice(start, end)
        x += [curve.x[run], curve.x[run][::-1], np.array([np.nan])]
        y += [high[run], low[run][::-1], np.array([np.nan])]
    return np.concatenate(x)[:-1], np.concatenate(y)[:-1]


def _small(values: Array) -> NDArray[np.float32]:
    """Round to seven digits: a screen shows no more, and they take half the bytes."""
    return values.astype(np.float32)


def _translucent(colour: str) -> str:
    red, green, blue = (int(colour[i : i + 2], 16) for i in (1, 3, 5))
    return f"rgba({red},{green},{blue},0.25)"
