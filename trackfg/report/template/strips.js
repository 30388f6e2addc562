// Charts of strips: panels over one axis, thinned to the pixels of the screen now and after every zoom.

const STRIP = 84, TOP = 8, BOTTOM = 46;
const INK = "#1c2733", GRID = "#e3e8ed", BASE = "#6b7280", LIMIT = "#c0392b";
const FONT = { family: "system-ui, 'Liberation Sans', 'DejaVu Sans', sans-serif", size: 12, color: INK };
const CONFIG = { displaylogo: false, displayModeBar: false, responsive: true, doubleClick: "reset" };
const SEEN_LINES = 400; // lines of fixes and stations through the panels: more would be a curtain
const unfinished = [], papers = [];

/** Where the panels of a chart of that width begin and end: on a phone labels stand above them, not beside. */
function frame(width) {
  return width < 700 ? { narrow: true, left: 46, right: 10, gap: 24 } : { narrow: false, left: 152, right: 178, gap: 11 };
}

function domains(panels, gap) {
  const total = panels.reduce((sum, panel) => sum + panel.share * STRIP, 0) + gap * (panels.length - 1);
  let top = total;
  return { total, parts: panels.map((panel) => {
    const bottom = top - panel.share * STRIP, part = [Math.max(bottom / total, 0), top / total];
    top = bottom - gap;
    return part;
  }) };
}

const axisOf = (i) => i === 0 ? "y" : `y${i + 1}`;
const layoutAxis = (i) => i === 0 ? "yaxis" : `yaxis${i + 1}`;

/** Every line of a chart with the numbers of its first view. */
async function entriesOf(chart) {
  const entries = [];
  for (const [i, panel] of chart.panels.entries()) {
    for (const line of panel.lines) {
      entries.push({ line, panel: i, data: await unpackedLine(line.view ?? line.all) });
    }
  }
  return entries;
}

/** The traces of a chart without their points: bands below, wide lines, the others, limits on top. */
function tracesOf(chart, entries) {
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
  chart.panels.forEach((panel, i) => {
    for (const limit of panel.limits) traces.push({ type: "scatter", mode: "lines", xaxis: "x", yaxis: axisOf(i),
      x: limit.x, y: limit.y, line: { color: LIMIT, width: 1.2, dash: "dash" }, showlegend: false, hoverinfo: "skip" });
  });
  return traces;
}

function layoutOf(chart, parts, total, legendRoom, { narrow, left, right }) {
  const layout = { // plotly writes into the arrays that it is given: ranges are copies
    height: total + TOP + BOTTOM + legendRoom + (narrow ? 20 : 0),
    margin: { l: left, r: right, t: TOP + legendRoom + (narrow ? 20 : 0), b: BOTTOM },
    font: FONT, hovermode: false, dragmode: "zoom", showlegend: chart.legend,
    plot_bgcolor: "rgba(255,255,255,0)", paper_bgcolor: "rgba(255,255,255,0)",
    legend: { orientation: "h", x: 0, xanchor: "left", y: 1 + (narrow ? 20 / total : 0), yanchor: "bottom", font: { size: 12 },
      ...(narrow ? { yref: "container", y: 1, yanchor: "top" } : {}) },
    xaxis: { range: [...chart.x.range], anchor: axisOf(chart.panels.length - 1),
      title: { text: chart.official === null ? chart.x.label : "km" },
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
    const text = panel.unit ? `${panel.label}, ${panel.unit}` : panel.label;
    layout.annotations.push({ xref: "paper", yref: "paper", x: 0, xanchor: "left", align: "left", showarrow: false,
      ...(narrow ? { text: text.replaceAll("<br>", " "), y: parts[i][1], yanchor: "bottom", font: { size: 12 } } :
        { text, xshift: -left + 2, y: (parts[i][0] + parts[i][1]) / 2, yanchor: "middle", font: { size: 12.5 } }) });
    if (panel.base !== null) layout.shapes.push({ type: "line", xref: "x domain", x0: 0, x1: 1, yref: axisOf(i),
      y0: panel.base, y1: panel.base, line: { color: BASE, width: 1 }, layer: "below" });
    if (!narrow) for (const [share, label] of limitLabels(panel)) {
      layout.annotations.push({ xref: "paper", yref: "paper", x: 1, xanchor: "left", xshift: 3, showarrow: false,
        text: label, y: parts[i][0] + share * (parts[i][1] - parts[i][0]), yanchor: "middle",
        font: { size: 10, color: LIMIT } });
    }
  });
  for (const [start, end, colour, panel] of chart.spans) layout.shapes.push({ type: "rect", xref: "x", x0: start, x1: end,
    yref: panel === null ? "paper" : `${axisOf(panel)} domain`, y0: 0, y1: 1, fillcolor: colour, opacity: .3,
    line: { width: 1, color: colour }, layer: "below" });
  const points = chart.places.flatMap(({ places }) => places.filter(([, , , kind]) => kind === "fix" || kind === "station"));
  for (const [x] of points.slice(0, SEEN_LINES)) layout.shapes.push({ type: "line", xref: "x", x0: x, x1: x,
    yref: "paper", y0: 0, y1: 1, line: { color: BASE, width: 1, dash: "dot" }, layer: "below" });
  return layout;
}

/** Height and text of the labels of a panel's limits, apart enough to be read. */
function limitLabels({ limits, range, share }) {
  if (range === null) return [];
  const [low, high] = range, placed = [];
  const wanted = limits.filter(({ label }) => label).map(({ label, y }) => {
    const value = y.findLast((one) => one !== null) ?? NaN;
    const height = (value - low) / (high - low), beyond = height > 1 ? " ↑" : height < 0 ? " ↓" : "";
    return [Math.min(Math.max(height, 0), 1), `${label} ${number(value)}${beyond}`, value];
  }).filter(([, , value]) => !Number.isNaN(value)).sort((a, b) => b[0] - a[0]);
  for (const [height, label] of wanted) {
    const below = placed.length ? placed[placed.length - 1][0] - .16 / share : Infinity;
    placed.push([Math.min(height, below), label]);
  }
  return placed;
}

/** Rows of a legend of these names, 29 px high: each name takes its letters of 12 px and 46 px for its line. */
function legendRows(names, width) {
  let rows = 1, used = 0;
  for (const name of names) {
    const wide = 46 + 7 * name.length;
    if (used && used + wide > width) { rows += 1; used = 0; }
    used += wide;
  }
  return rows;
}

async function drawStrips(element, chart) {
  const made = (name, kind) => { const one = document.createElement(name); one.className = kind; return one; };
  const tools = made("div", "tools"), keys = made("div", "keys"), head = made("div", "head"), plot = made("div", "plot");
  element.append(tools, keys, head, plot);
  const shape = frame(element.clientWidth), { total, parts } = domains(chart.panels, shape.gap);
  const names = new Set(chart.panels.flatMap((panel) => panel.lines.map((line) => line.name)));
  const legendRoom = chart.legend ? 29 * legendRows(names, element.clientWidth - shape.left - shape.right) : 0;
  const entries = await entriesOf(chart);
  await window.plotlyLoaded;
  const traces = tracesOf(chart, entries), width = () => Math.max(element.clientWidth - shape.left - shape.right, 120);
  const filled = (range) => {
    const xs = [], ys = [], indices = [];
    const put = (index, points) => { indices.push(index); xs.push(points.x); ys.push(points.y); };
    for (const { line, data, trace, band } of entries) {
      put(trace, curve(data, range, Math.max(width(), 200)));
      if (band !== undefined) put(band, outline(data, chart.band, line.aboutZero, range, Math.max(width(), 200) >> 1));
    }
    return { xs, ys, indices };
  };
  const first = filled(chart.x.range);
  first.indices.forEach((index, k) => { traces[index].x = first.xs[k]; traces[index].y = first.ys[k]; });
  const layout = layoutOf(chart, parts, total, legendRoom, shape);
  const grid = (range) => {
    const found = ticks(chart, range, Math.max(3, Math.floor(width() / 90)));
    return { "xaxis.tickvals": found.map(([x]) => x), "xaxis.ticktext": found.map(([, text]) => text) };
  };
  const heading = (range) => head.replaceChildren(axisHead(chart, range, shape.left, width(), element.clientWidth));
  const begun = grid(chart.x.range);
  Object.assign(layout.xaxis, { tickvals: begun["xaxis.tickvals"], ticktext: begun["xaxis.ticktext"] });
  heading(chart.x.range);
  await Plotly.newPlot(plot, traces, layout, CONFIG);

  let all = null; // the promise that every row is there
  const everyRow = () => all ??= (async () => {
    for (const entry of entries) if (entry.line.view !== null) entry.data = await unpackedLine(entry.line.all);
    plot.dataset.rows = "all"; // of this plot, not of the one that is drawn in its place
  })();
  unfinished.push(everyRow);

  let shown = chart.x.range;
  const reach = tool(tools, chart, plot);
  const refresh = async () => {
    await everyRow();
    const { xs, ys, indices } = filled(shown);
    heading(shown);
    await Plotly.update(plot, { x: xs, y: ys }, {
      ...grid(shown),
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
  const window_ = { shown: () => shown, show: (range) => Plotly.relayout(plot, { "xaxis.range": range }) };
  const cursor = reading({ element, plot, chart, parts, entries, legendRoom, shape, everyRow, window_ });
  buttons(keys, chart, window_, cursor, plot);
  const resized = new ResizeObserver(() => {
    if (!element.clientWidth) return;
    if (frame(element.clientWidth).narrow === shape.narrow) { heading(shown); return; }
    resized.disconnect(); // the chart that is drawn in its place has its own
    redraw(element);
  });
  resized.observe(element);
  if (chart.paper !== null) papers.push({ element, chart, entries, select: keys.querySelector("select") });
  element.dataset.shown = shown.join(" ");
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

function button(text, action) {
  const made = document.createElement("button");
  made.type = "button";
  made.textContent = text;
  made.addEventListener("click", action);
  return made;
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
  tools.append(chart.official === null ? "from" : "chainage from", from, "to", to, chart.x.unit, button("whole run", () => {
    Plotly.relayout(plot, { "xaxis.range": [...chart.x.range] });
  }), label);
  show(chart.x.range);
  return { show, fit };
}

/** What a key or a button does to the window: part of it to move by, and the share of it that is left. */
const MOVES = {
  "-": [0, 2], "+": [0, .5], "=": [0, .5], PageUp: [-.8, 1], PageDown: [.8, 1],
};

function moved(chart, [from, to], [by, left]) {
  const whole = chart.x.range, length = Math.min((to - from) * left, whole[1] - whole[0]);
  const start = (from + to - length) / 2 + by * (to - from);
  const low = Math.min(Math.max(start, whole[0]), whole[1] - length);
  return [low, low + length];
}

/** Buttons for what the pointer does by dragging, the scale on paper, and the chart as a picture; keys do the same. */
function buttons(keys, chart, window_, cursor, plot) {
  const go = (key) => window_.show(moved(chart, window_.shown(), MOVES[key]));
  keys.append(button("back", () => go("PageUp")), button("on", () => go("PageDown")),
    button("zoom in", () => go("+")), button("zoom out", () => go("-")),
    button("save picture", () => Plotly.downloadImage(plot, { format: "png", scale: 2, filename: document.title })));
  if (chart.paper !== null) {
    const label = document.createElement("label"), select = document.createElement("select");
    for (const metres of [250, 500, 1000, 2500, 5000]) {
      select.append(new Option(`1:${4 * metres} (${metres} m a sheet)`, metres, metres === chart.paper, metres === chart.paper));
    }
    label.append("on paper ", select);
    keys.append(label);
  }
  keys.append("Drag across a chart to zoom, double-click for the whole run. Keys: arrows read, + and − zoom, page keys move.");
  plot.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.altKey || event.metaKey) return;
    if (event.key in MOVES) go(event.key);
    else if (event.key === "Escape") window_.show([...chart.x.range]);
    else if (event.key === "ArrowLeft" || event.key === "ArrowRight") {
      cursor.step((event.key === "ArrowLeft" ? -1 : 1) * (event.shiftKey ? 10 : 1));
    } else return;
    event.preventDefault();
  });
}

/** A line under the pointer through all panels, and in each panel what its curves are there, of all rows. */
function reading({ element, plot, chart, parts, entries, legendRoom, shape, everyRow, window_ }) {
  const cursor = document.createElement("div"), texts = chart.panels.map(() => document.createElement("div"));
  const output = document.createElement("output"), spoken = document.createElement("div");
  const here = document.createElement("span");
  here.className = "here";
  element.querySelector(".tools").append(output, here);
  spoken.className = "unseen";
  spoken.setAttribute("role", "status");
  cursor.className = "cursor";
  let pointed = null;
  const room = TOP + legendRoom + (shape.narrow ? 20 : 0);
  const lay = () => {
    const height = plot.layout.height - BOTTOM - room, top = plot.offsetTop + room;
    cursor.style.top = `${top}px`;
    cursor.style.height = `${height}px`;
    texts.forEach((text, i) => {
      const at = shape.narrow ? parts[i][1] : (parts[i][0] + parts[i][1]) / 2;
      text.style.top = `${top + height * (1 - at) - (shape.narrow ? 10 : 0)}px`;
    });
  };
  for (const text of texts) text.className = shape.narrow ? "reading narrow" : "reading";
  element.append(cursor, ...texts, spoken);
  const hide = () => {
    cursor.style.display = "none";
    output.textContent = here.textContent = "";
    for (const text of texts) text.replaceChildren();
  };
  const show = (at) => {
    lay();
    pointed = at;
    const [from, to] = window_.shown(), width = plot.clientWidth - shape.left - shape.right;
    cursor.style.display = "block";
    cursor.style.left = `${shape.left + width * (at - from) / (to - from)}px`;
    output.textContent = placeText(chart, at);
    const lines = chart.panels.map(() => []), places = [], near = 6 * (to - from) / width;
    for (const { line, panel, data, trace } of entries) {
      if (plot.data[trace].visible !== true) continue;
      const row = nearest(data.x, at);
      if (row < 0 || Number.isNaN(data.y[row])) continue;
      const sigma = data.sigma === null ? NaN : data.sigma[row];
      if (sigma > 0) places[panel] = Math.min(Math.max(1 - Math.floor(Math.log10(sigma)), 0), 8);
      const div = document.createElement("div"), digits = places[panel];
      div.style.color = `color-mix(in srgb, ${line.colour} 78%, #000)`; // a text needs more contrast than a line
      div.dataset.name = line.name;
      div.textContent = digits === undefined ? number(data.y[row]) :
        data.y[row].toFixed(digits) + (sigma > 0 ? ` ± ${sigma.toFixed(digits)}` : "");
      lines[panel].push(div);
    }
    texts.forEach((text, i) => text.replaceChildren(...lines[i].slice(0, Math.floor(6 * chart.panels[i].share))));
    const there = chart.places.flatMap(({ places: row }) => row)
      .filter(([start, end]) => start - near <= at && at <= end + near).map(([, , text]) => text);
    here.textContent = there.slice(0, 3).join("; ");
  };
  element.addEventListener("mouseleave", hide);
  plot.addEventListener("blur", hide);
  element.addEventListener("mousemove", (event) => {
    const box = plot.getBoundingClientRect(), width = box.width - shape.left - shape.right;
    const across = event.clientX - box.left - shape.left;
    if (across < 0 || across > width || event.target.closest(".tools, .keys")) { hide(); return; }
    if (plot.dataset.rows !== "all") { everyRow(); return; }
    const [from, to] = window_.shown();
    show(from + (to - from) * across / width);
  });
  const step = async (count) => {
    await everyRow();
    const [from, to] = window_.shown(), inside = pointed !== null && pointed >= from && pointed <= to;
    show(Math.min(Math.max((inside ? pointed : (from + to) / 2) + count * (to - from) / 200, from), to));
    spoken.textContent = `${output.textContent}. ${here.textContent}. ` + chart.panels.map((panel, i) => [...texts[i].children].map((div) =>
      `${panel.label.replaceAll("<br>", " ")} ${div.dataset.name} ${div.textContent} ${panel.unit}`).join(", "))
      .filter((text) => text).join("; ");
  };
  return { step };
}

/** The row nearest to a place; -1 where the table is not near it. */
function nearest(x, at) {
  const after = place(x, at);
  const row = after === x.length || (after > 0 && at - x[after - 1] < x[after] - at) ? after - 1 : after;
  const spacing = x.length > 1 ? (x[x.length - 1] - x[0]) / (x.length - 1) : 0;
  return x.length && Math.abs(x[row] - at) <= 2 * spacing ? row : -1;
}
