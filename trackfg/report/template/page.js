"use strict";
// Draws the charts of the page. Long curves are thinned to the pixels of their panel, now and after every zoom.
(() => {
  const spec = JSON.parse(document.getElementById("spec").textContent);
  const STRIP = 84, TOP = 8, BOTTOM = 46, LEFT = 152, RIGHT = 134, GAP = 11;
  const INK = "#1c2733", GRID = "#e3e8ed", BASE = "#6b7280";
  const FONT = { family: "system-ui, 'Liberation Sans', 'DejaVu Sans', sans-serif", size: 12, color: INK };
  const CONFIG = {
    displaylogo: false, responsive: true, doubleClick: "reset",
    modeBarButtons: [["toImage"], ["zoom2d", "pan2d"], ["zoomIn2d", "zoomOut2d", "resetScale2d"]],
  };

  // ---- columns

  const unpacked = new Map();
  let folded = new Int32Array(0); // used between two awaits only

  /** The numbers of a column, NaN where there is none; undoes trackfg/report/columns.py. */
  function column(number) {
    if (!unpacked.has(number)) unpacked.set(number, unpack(number));
    return unpacked.get(number);
  }

  async function unpack(number) {
    const { rows, step, order, planes, gaps } = spec.columns[number];
    const squeezed = bytesOf(document.getElementById(`column-${number}`).textContent);
    const stream = new Blob([squeezed]).stream().pipeThrough(new DecompressionStream("deflate"));
    const bytes = new Uint8Array(await new Response(stream).arrayBuffer());
    if (folded.length < rows) folded = new Int32Array(rows);
    for (let p = 0; p < planes; p++) {
      const plane = bytes.subarray(p * rows, (p + 1) * rows), shift = 8 * p;
      if (p === 0) for (let i = 0; i < rows; i++) folded[i] = plane[i];
      else for (let i = 0; i < rows; i++) folded[i] |= plane[i] << shift;
    }
    const twice = order === 2, values = new Float64Array(rows);
    let value = 0, slope = 0;
    for (let i = 0; i < rows; i++) {
      const difference = (folded[i] >>> 1) ^ -(folded[i] & 1);
      if (twice) { slope += difference; value += slope; } else value += difference;
      values[i] = value * step;
    }
    if (gaps) for (let i = 0, at = planes * rows; i < rows; i++) if (bytes[at + i]) values[i] = NaN;
    return values;
  }

  function bytesOf(base64) {
    if (Uint8Array.fromBase64) return Uint8Array.fromBase64(base64);
    const text = atob(base64), bytes = new Uint8Array(text.length);
    for (let i = 0; i < text.length; i++) bytes[i] = text.charCodeAt(i);
    return bytes;
  }

  const differences = new Map();

  async function values(reference) {
    if (!Array.isArray(reference)) return column(reference);
    const key = reference.join();
    if (!differences.has(key)) {
      const [a, b] = await Promise.all(reference.map(column));
      differences.set(key, a.map((value, i) => value - b[i]));
    }
    return differences.get(key);
  }

  async function unpackedLine({ x, y, sigma }) {
    const [xs, ys, sigmas] = await Promise.all([values(x), values(y), sigma === null ? null : values(sigma)]);
    return { x: xs, y: ys, sigma: sigmas };
  }

  // ---- thinning

  /** The first index at which ascending x is at least (or, after, above) the value. */
  function place(x, value, after = false) {
    let low = 0, high = x.length;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (after ? x[middle] <= value : x[middle] < value) low = middle + 1; else high = middle;
    }
    return low;
  }

  /** Rows of the window and one beyond each end. */
  function window_(x, [from, to]) {
    return [Math.max(place(x, from) - 1, 0), Math.min(place(x, to, true) + 1, x.length)];
  }

  /** What can be seen of rows [start, end) in so many columns of pixels: all, or of each stretch its extremes and gaps. */
  function thinned(y, start, end, stretches) {
    const n = end - start, keep = [];
    if (n <= 2 * stretches) {
      for (let i = start; i < end; i++) keep.push(i);
      return keep;
    }
    for (let s = 0; s < stretches; s++) {
      const first = start + Math.floor(s * n / stretches), stop = start + Math.floor((s + 1) * n / stretches);
      let low = -1, high = -1, gap = -1, lastGap = -1;
      for (let i = first; i < stop; i++) {
        const value = y[i];
        if (value !== value) { if (gap < 0) gap = i; lastGap = i; continue; }
        if (low < 0 || value < y[low]) low = i;
        if (high < 0 || value >= y[high]) high = i;
      }
      const kept = [];
      if (s === 0) kept.push(start);
      if (low >= 0) kept.push(low, high);
      if (gap >= 0) kept.push(Math.max(gap - 1, start), gap, lastGap, Math.min(lastGap + 1, end - 1));
      if (s === stretches - 1) kept.push(end - 1);
      kept.sort((a, b) => a - b);
      for (const i of kept) if (keep.length === 0 || i > keep[keep.length - 1]) keep.push(i);
    }
    return keep;
  }

  function curve(data, range, stretches) {
    const keep = thinned(data.y, ...window_(data.x, range), stretches);
    return { x: keep.map((i) => data.x[i]), y: keep.map((i) => Number.isNaN(data.y[i]) ? null : data.y[i]) };
  }

  /** The outline of a band, there and back, one closed line for each stretch without gaps; of each stretch of many rows
   * the widest. */
  function outline(data, half, aboutZero, range, stretches) {
    const [start, end] = window_(data.x, range);
    const n = end - start, whole = n <= 2 * stretches, count = whole ? n : stretches;
    const out = { x: [], y: [] };
    let xs = [], upper = [], lower = [];
    const close = () => {
      if (xs.length) {
        if (out.x.length) { out.x.push(null); out.y.push(null); }
        for (let i = 0; i < xs.length; i++) { out.x.push(xs[i]); out.y.push(upper[i]); }
        for (let i = xs.length - 1; i >= 0; i--) { out.x.push(xs[i]); out.y.push(lower[i]); }
      }
      xs = []; upper = []; lower = [];
    };
    for (let s = 0; s < count; s++) {
      const first = whole ? start + s : start + Math.floor(s * n / count);
      const stop = whole ? first + 1 : start + Math.floor((s + 1) * n / count);
      let high = -Infinity, low = Infinity, gap = false;
      for (let i = first; i < stop; i++) {
        const y = aboutZero ? 0 : data.y[i], top = y + half * data.sigma[i], bottom = y - half * data.sigma[i];
        if (top !== top || data.y[i] !== data.y[i]) { gap = true; continue; }
        if (top > high) high = top;
        if (bottom < low) low = bottom;
      }
      if (high >= low) { xs.push(data.x[(first + stop - 1) >> 1]); upper.push(high); lower.push(low); }
      if (gap) close();
    }
    close();
    return out;
  }

  // ---- charts of strips

  const unfinished = [];

  function domains(panels) {
    const total = panels.reduce((sum, panel) => sum + panel.share * STRIP, 0) + GAP * (panels.length - 1);
    let top = total;
    return { total, parts: panels.map((panel) => {
      const bottom = top - panel.share * STRIP, part = [Math.max(bottom / total, 0), top / total];
      top = bottom - GAP;
      return part;
    }) };
  }

  const axisOf = (i) => i === 0 ? "y" : `y${i + 1}`;
  const layoutAxis = (i) => i === 0 ? "yaxis" : `yaxis${i + 1}`;

  async function drawStrips(element, chart) {
    const tools = document.createElement("div"), plot = document.createElement("div");
    tools.className = "tools";
    plot.className = "plot";
    element.append(tools, plot);
    const { total, parts } = domains(chart.panels);
    const names = new Set(chart.panels.flatMap((panel) => panel.lines.map((line) => line.name)));
    const legendRoom = chart.legend ? 26 + 20 * Math.floor(names.size / 6) : 0;
    const entries = [];
    for (const [i, panel] of chart.panels.entries()) {
      for (const line of panel.lines) {
        entries.push({ line, panel: i, data: await unpackedLine(line.view ?? line.all) });
      }
    }
    const named = new Set(), traces = [];
    const ofPanel = (entry) => ({ xaxis: "x", yaxis: axisOf(entry.panel), legendgroup: entry.line.name,
      visible: entry.line.shown ? true : "legendonly", hoverinfo: "skip" });
    for (const entry of entries.filter((entry) => entry.data.sigma !== null)) {
      entry.band = traces.length;
      traces.push({ ...ofPanel(entry), type: "scatter", mode: "lines", line: { width: 0 }, fill: "toself",
        fillcolor: entry.line.colour + "38", showlegend: false, x: [], y: [] });
    }
    for (const entry of [...entries].sort((a, b) => b.line.wide - a.line.wide)) {
      entry.trace = traces.length;
      traces.push({ ...ofPanel(entry), type: "scatter", mode: "lines", name: entry.line.name, x: [], y: [],
        line: { color: entry.line.colour, width: entry.line.wide ? 3.2 : 1.25 },
        showlegend: chart.legend && !named.has(entry.line.name) });
      named.add(entry.line.name);
    }

    const stretches = () => Math.max(element.clientWidth - LEFT - RIGHT, 200);
    const filled = (range) => {
      const xs = [], ys = [], indices = [];
      const put = (index, points) => { indices.push(index); xs.push(points.x); ys.push(points.y); };
      for (const { line, data, trace, band } of entries) {
        put(trace, curve(data, range, stretches()));
        if (band !== undefined) put(band, outline(data, chart.band, line.aboutZero, range, stretches() >> 1));
      }
      return { xs, ys, indices };
    };
    const first = filled(chart.x.range);
    first.indices.forEach((index, k) => { traces[index].x = first.xs[k]; traces[index].y = first.ys[k]; });

    const layout = { // plotly writes into the arrays that it is given: ranges are copies
      height: total + TOP + BOTTOM + legendRoom, margin: { l: LEFT, r: RIGHT, t: TOP + legendRoom, b: BOTTOM },
      font: FONT, hovermode: false, dragmode: "zoom", showlegend: chart.legend, plot_bgcolor: "#fff",
      legend: { orientation: "h", x: 0, xanchor: "left", y: 1, yanchor: "bottom", font: { size: 12 } },
      xaxis: { range: [...chart.x.range], anchor: axisOf(chart.panels.length - 1), title: { text: chart.x.label },
        exponentformat: "none", zeroline: false, gridcolor: GRID, showline: true, linecolor: BASE, ticks: "outside",
        separatethousands: true },
      shapes: [],
      annotations: [],
    };
    chart.panels.forEach((panel, i) => {
      layout[layoutAxis(i)] = { domain: parts[i], anchor: "x", fixedrange: true, zeroline: false, gridcolor: GRID,
        nticks: panel.share <= 1 ? 5 : 8, tickfont: { size: 10.5 }, exponentformat: "none", showline: true,
        linecolor: BASE, automargin: false,
        ...(panel.range ? { range: [...panel.range] } : {}) };
      layout.annotations.push({ text: panel.unit ? `${panel.label}, ${panel.unit}` : panel.label, xref: "paper",
        yref: "paper", x: 0, xshift: -LEFT + 2, xanchor: "left", y: (parts[i][0] + parts[i][1]) / 2,
        yanchor: "middle", align: "left", showarrow: false, font: { size: 12.5 } });
      if (panel.base !== null) layout.shapes.push({ type: "line", xref: "x domain", x0: 0, x1: 1, yref: axisOf(i),
        y0: panel.base, y1: panel.base, line: { color: BASE, width: 1 }, layer: "below" });
    });
    for (const [start, end, colour] of chart.spans) layout.shapes.push({ type: "rect", xref: "x", x0: start, x1: end,
      yref: "paper", y0: 0, y1: 1, fillcolor: colour, opacity: .3, line: { width: 1, color: colour }, layer: "below" });
    const labels = layout.annotations;
    layout.annotations = [...labels, ...marks(chart, parts, chart.x.range, stretches())];
    await Plotly.newPlot(plot, traces, layout, CONFIG);

    let all = null; // the promise that every row is there
    const everyRow = () => all ??= (async () => {
      for (const entry of entries) if (entry.line.view !== null) entry.data = await unpackedLine(entry.line.all);
      element.dataset.rows = "all";
    })();
    unfinished.push(everyRow);

    let shown = chart.x.range;
    const reach = tool(tools, chart, plot);
    const refresh = async () => {
      await everyRow();
      const { xs, ys, indices } = filled(shown);
      await Plotly.update(plot, { x: xs, y: ys }, {
        annotations: [...labels, ...marks(chart, parts, shown, stretches())],
        ...scales(chart, plot, entries, shown, reach.fit.checked) }, indices);
      element.dataset.shown = shown.join(" ");
    };
    plot.on("plotly_relayout", (change) => {
      if (!Object.keys(change).some((key) => key.startsWith("xaxis.range") || key === "xaxis.autorange")) return;
      const range = plot.layout.xaxis.range.map(Number);
      if (range[0] === shown[0] && range[1] === shown[1]) return;
      shown = range;
      reach.show(shown);
      refresh();
    });
    reach.fit.addEventListener("change", refresh);
    reading(element, plot, chart, parts, entries, legendRoom, () => shown, everyRow);
    element.dataset.shown = shown.join(" ");
  }

  /** The names along the axis that have room, the longest stretches first. */
  function marks(chart, parts, [from, to], width) {
    const room = (to - from) * 84 / width, placed = [];
    chart.panels.forEach((panel, i) => {
      const inside = panel.marks.map(([start, end, text]) => [Math.max(start, from), Math.min(end, to), text])
        .filter(([start, end]) => end - start >= .2 * room).sort((a, b) => (b[1] - b[0]) - (a[1] - a[0]));
      const taken = [];
      for (const [start, end, text] of inside) {
        const middle = Math.min(Math.max((start + end) / 2, from + room / 2), to - room / 2);
        if (taken.some((other) => Math.abs(other - middle) < room)) continue;
        taken.push(middle);
        placed.push({ text, x: middle, xref: "x", xanchor: "center", y: parts[i][1], yref: "paper", yanchor: "top",
          showarrow: false, font: { size: 11 }, bgcolor: "rgba(255,255,255,.7)", borderpad: 1 });
      }
    });
    return placed;
  }

  /** Vertical scales: those of the whole run, or around what the window holds. */
  function scales(chart, plot, entries, range, fit) {
    const change = {};
    chart.panels.forEach((panel, i) => {
      if (!fit) { if (panel.range) change[`${layoutAxis(i)}.range`] = [...panel.range]; return; }
      let low = Infinity, high = -Infinity;
      for (const { panel: at, data, trace } of entries) {
        if (at !== i || plot.data[trace].visible !== true) continue;
        for (let k = place(data.x, range[0]), end = place(data.x, range[1], true); k < end; k++) {
          if (data.y[k] < low) low = data.y[k];
          if (data.y[k] > high) high = data.y[k];
        }
      }
      const air = .1 * (high - low) || 1;
      if (high >= low) change[`${layoutAxis(i)}.range`] = [low - air, high + air];
    });
    return change;
  }

  /** The line above a chart: the window as numbers, and whether the vertical scales follow it. */
  function tool(tools, chart, plot) {
    const field = (name) => {
      const input = document.createElement("input");
      input.type = "text";
      input.inputMode = "decimal";
      input.setAttribute("aria-label", name);
      return input;
    };
    const button = (text, action) => {
      const made = document.createElement("button");
      made.type = "button";
      made.textContent = text;
      made.addEventListener("click", action);
      return made;
    };
    const from = field("from"), to = field("to"), fit = document.createElement("input"), label = document.createElement("label");
    const show = ([low, high]) => {
      const digits = Math.max(0, 3 - Math.floor(Math.log10(high - low)));
      from.value = low.toFixed(digits);
      to.value = high.toFixed(digits);
    };
    const go = () => {
      const range = [Number(from.value), Number(to.value)];
      if (range[1] > range[0]) Plotly.relayout(plot, { "xaxis.range": range });
    };
    for (const input of [from, to]) input.addEventListener("change", go);
    fit.type = "checkbox";
    label.append(fit, " fit the vertical scales to what is shown");
    tools.append("from", from, "to", to, chart.x.unit, button("whole run", () => {
      Plotly.relayout(plot, { "xaxis.range": [...chart.x.range] });
    }), label, "Drag across a chart to zoom, double-click for the whole run.");
    show(chart.x.range);
    return { show, fit };
  }

  /** A line under the pointer through all panels, and beside each panel what its curves are there, of all rows. */
  function reading(element, plot, chart, parts, entries, legendRoom, shown, everyRow) {
    const cursor = document.createElement("div"), texts = chart.panels.map(() => document.createElement("div"));
    const output = document.createElement("output");
    element.querySelector(".tools").append(output);
    cursor.className = "cursor";
    const place_ = () => {
      const height = plot.layout.height - TOP - BOTTOM - legendRoom, top = plot.offsetTop + TOP + legendRoom;
      cursor.style.top = `${top}px`;
      cursor.style.height = `${height}px`;
      texts.forEach((text, i) => { text.style.top = `${top + height * (1 - (parts[i][0] + parts[i][1]) / 2)}px`; });
    };
    for (const text of texts) text.className = "reading";
    element.append(cursor, ...texts);
    const hide = () => {
      cursor.style.display = "none";
      output.textContent = "";
      for (const text of texts) text.replaceChildren();
    };
    plot.addEventListener("mouseleave", hide);
    plot.addEventListener("mousemove", (event) => {
      const box = plot.getBoundingClientRect(), width = box.width - LEFT - RIGHT, across = event.clientX - box.left - LEFT;
      if (across < 0 || across > width) { hide(); return; }
      if (element.dataset.rows !== "all") { everyRow(); return; }
      place_();
      const [from, to] = shown(), at = from + (to - from) * across / width;
      cursor.style.display = "block";
      cursor.style.left = `${LEFT + across}px`;
      output.textContent = `${chart.x.label.replace(/,.*/, "")} ${at.toFixed(chart.x.unit === "km" ? 4 : 2)} ${chart.x.unit}`;
      const lines = chart.panels.map(() => []), places = [];
      for (const { line, panel, data, trace } of entries) {
        if (plot.data[trace].visible !== true) continue;
        const row = nearest(data.x, at);
        if (row < 0 || Number.isNaN(data.y[row])) continue;
        const sigma = data.sigma === null ? NaN : data.sigma[row];
        if (sigma > 0) places[panel] = Math.min(Math.max(1 - Math.floor(Math.log10(sigma)), 0), 8);
        const div = document.createElement("div"), digits = places[panel];
        div.style.color = line.wide ? "#9a6b00" : line.colour;
        div.textContent = digits === undefined ? number(data.y[row]) :
          data.y[row].toFixed(digits) + (sigma > 0 ? ` ± ${sigma.toFixed(digits)}` : "");
        lines[panel].push(div);
      }
      texts.forEach((text, i) => text.replaceChildren(...lines[i].slice(0, Math.floor(6 * chart.panels[i].share))));
    });
  }

  /** The row nearest to a place; -1 where the table is not near it. */
  function nearest(x, at) {
    const after = place(x, at);
    const row = after === x.length || (after > 0 && at - x[after - 1] < x[after] - at) ? after - 1 : after;
    const spacing = x.length > 1 ? (x[x.length - 1] - x[0]) / (x.length - 1) : 0;
    return x.length && Math.abs(x[row] - at) <= 2 * spacing ? row : -1;
  }

  function number(value) {
    if (value === 0) return "0";
    const size = Math.floor(Math.log10(Math.abs(value)));
    return size < -4 || size > 6 ? value.toExponential(3) : value.toFixed(Math.max(3 - size, 0));
  }

  // ---- all of them

  async function drawFigure(element, chart) {
    const plot = document.createElement("div");
    plot.className = "plot";
    element.append(plot);
    await Plotly.newPlot(plot, chart.traces, { font: FONT, ...chart.layout, height: chart.height }, CONFIG);
  }

  async function draw(element) {
    const chart = spec.charts[Number(element.dataset.chart)];
    try {
      await (chart.kind === "strips" ? drawStrips : drawFigure)(element, chart);
      element.dataset.drawn = "yes";
      performance.mark(`chart ${element.dataset.chart}`);
    } catch (error) {
      const text = document.createElement("p");
      text.className = "failed";
      text.textContent = `This chart could not be drawn: ${error}`;
      element.replaceChildren(text);
      console.error(error);
    }
  }

  // On paper the charts have the width of the sheet (page.css scales them), whatever the window's is.
  const PAPER = 1230;
  const plots = () => document.querySelectorAll(".chart[data-drawn] > .plot");
  addEventListener("beforeprint", () => { for (const plot of plots()) Plotly.relayout(plot, { width: PAPER }); });
  addEventListener("afterprint", () => { for (const plot of plots()) Plotly.relayout(plot, { width: null, autosize: true }); });

  const pause = () => new Promise((resolve) => setTimeout(resolve, 0));

  async function main() {
    const hidden = (element) => element.closest("details:not([open])") !== null;
    for (const details of document.querySelectorAll("details")) {
      details.addEventListener("toggle", () => {
        for (const element of details.querySelectorAll(".chart:empty")) draw(element);
      });
    }
    for (const element of document.querySelectorAll(".chart")) {
      if (hidden(element)) continue;
      await pause(); // the page can be scrolled and clicked between two charts
      await draw(element);
    }
    document.documentElement.dataset.charts = "drawn";
    performance.mark("charts drawn");
    for (const everyRow of unfinished) {
      await pause();
      await everyRow();
    }
    performance.mark("every row");
  }

  main();
})();
