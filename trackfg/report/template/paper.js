// Strip charts on paper: a sheet of A4 for each stretch of the line, at a round scale, drawn when the page is printed.

const SHEET = { width: 1108, height: 672, left: 92, across: 1000 }; // quarters of a millimetre: 277 x 168 mm, 250 mm of track
const CURVE_POINTS = 1400; // stretches of a sheet's curves: more than a printer's dots can show apart

/** Where the sheets of a chart begin and end, in the unit of its axis: at whole multiples of their length. */
function sheetsOf(chart, metres) {
  const length = chart.x.unit === "km" ? metres / 1000 : metres, [from, to] = chart.x.range, found = [];
  for (let k = Math.floor(from / length + 1e-9); k * length < to - 1e-9 * length; k++) found.push([k * length, (k + 1) * length]);
  return found;
}

/** The path of points through their gaps. */
function path({ x, y }, across, up) {
  let text = "", pen = "M";
  for (let i = 0; i < x.length; i++) {
    if (x[i] === null || y[i] === null) { pen = "M"; continue; }
    text += `${pen}${across(x[i]).toFixed(1)},${up(y[i]).toFixed(1)}`;
    pen = "L";
  }
  return text;
}

/** The pieces of a limit that lie in a range, each cut at its ends. */
function within({ x, y }, [from, to]) {
  const cut = { x: [], y: [] };
  for (let i = 0; i + 1 < x.length; i++) {
    if (y[i] === null || y[i + 1] === null || x[i + 1] < from || x[i] > to) continue;
    cut.x.push(Math.max(x[i], from), Math.min(x[i + 1], to), null);
    cut.y.push(y[i], y[i + 1], null);
  }
  return cut;
}

function sheet({ chart, entries }, range, name) {
  const { width, height, left, across } = SHEET;
  const drawing = svg("svg", { class: "sheet", viewBox: `0 0 ${width} ${height}`, role: "img", "aria-label": name });
  drawing.append(svg("text", { x: 0, y: 15, class: "title" }, name));
  const head = svg("g", { transform: "translate(0,24)" }), used = 24 + drawAxis(head, chart, range, left, across) + 6;
  const clip = `sheet-${Math.random().toString(36).slice(2)}`, defs = svg("defs");
  drawing.append(head, defs);
  const shares = chart.panels.reduce((sum, panel) => sum + panel.share, 0), gap = 5;
  const unit = (height - used - gap * (chart.panels.length - 1)) / shares;
  const at = (x) => left + across * (x - range[0]) / (range[1] - range[0]);
  let top = used;
  const grid = ticks(chart, range, 10);
  chart.panels.forEach((panel, i) => {
    const tall = unit * panel.share, [low, high] = panel.range ?? [0, 1], group = svg("g");
    const up = (y) => top + tall * (high - y) / (high - low), id = `${clip}-${i}`;
    const window_ = svg("clipPath", { id });
    window_.append(svg("rect", { x: left, y: top, width: across, height: tall }));
    defs.append(window_);
    for (const [start, end, colour, inPanel] of chart.spans) if ((inPanel ?? i) === i && end >= range[0] && start <= range[1]) {
      group.append(svg("rect", { x: at(Math.max(start, range[0])), y: top, height: tall, fill: colour, opacity: .25,
        width: Math.max(at(Math.min(end, range[1])) - at(Math.max(start, range[0])), .8) }));
    }
    for (const [x] of grid) group.append(svg("line", { x1: at(x), x2: at(x), y1: top, y2: top + tall, class: "grid" }));
    const marksOfY = ticks({ official: null }, [low, high], 4);
    for (const [y, text] of marksOfY) {
      group.append(svg("line", { x1: left, x2: left + across, y1: up(y), y2: up(y), class: "grid" }));
      group.append(svg("text", { x: left - 4, y: up(y) + 3, "text-anchor": "end", class: "small" }, text));
    }
    if (panel.base !== null) group.append(svg("line", { x1: left, x2: left + across, y1: up(panel.base), y2: up(panel.base), class: "base" }));
    const lines = svg("g", { "clip-path": `url(#${id})` });
    const own = entries.filter((entry) => entry.panel === i && entry.line.shown);
    for (const { line, data } of own) if (data.sigma !== null) {
      const band = outline(data, chart.band, line.aboutZero, range, CURVE_POINTS >> 1);
      lines.append(svg("path", { d: path(band, at, up), fill: line.colour, opacity: .22 }));
    }
    for (const { line, data } of own.sort((a, b) => b.line.wide - a.line.wide)) {
      lines.append(svg("path", { d: path(curve(data, range, CURVE_POINTS), at, up), fill: "none", stroke: line.colour,
        "stroke-width": line.wide ? 2.6 : 1 }));
    }
    for (const limit of panel.limits) lines.append(svg("path", { d: path(within(limit, range), at, up), class: "limit" }));
    group.append(lines, svg("rect", { x: left, y: top, width: across, height: tall, class: "frame" }));
    const words = panel.label.split("<br>");
    words.push(panel.unit);
    words.forEach((word, k) => group.append(svg("text", { x: 0, y: top + tall / 2 + 11 * (k - (words.length - 1) / 2) + 3,
      class: "small" }, word)));
    for (const [share, label] of limitLabels(panel)) {
      const y = Math.max(top + tall * (1 - share) - 2, top + 7);
      group.append(svg("text", { x: left + across - 3, y, "text-anchor": "end", class: "limit-name" }, label));
    }
    drawing.append(group);
    top += tall + gap;
  });
  return drawing;
}

const PAPER = 1230, ROOM = 640; // pixels of a plot's width on paper, and of the height that a sheet has for it

/** Draw the sheets of every chart that has a scale, and scale the others so that each fits a sheet. */
function toPaper() {
  for (const details of document.querySelectorAll("details:not([open]):not(.alternative)")) {
    details.dataset.shut = "yes";
    details.open = true;
  }
  for (const one of papers) {
    const metres = Number(one.select.value), title = document.querySelector("h1").textContent, box = document.createElement("div");
    box.className = "sheets";
    const all = sheetsOf(one.chart, metres);
    all.forEach((range, i) => {
      const ends = range.map((x) => placeText(one.chart, x)).join(" to ");
      const legend = one.chart.legend ? ", ochre and wide: truth, blue: estimate" : "";
      box.append(sheet(one, range, `${title}, ${ends}, 1:${4 * metres}${legend}. Sheet ${i + 1} of ${all.length}`));
    });
    one.element.querySelector(".sheets")?.remove();
    one.element.append(box);
  }
  for (const plot of plots()) {
    plot.parentElement.style.setProperty("--zoom", Math.min(.82, ROOM / plot.layout.height));
    Plotly.relayout(plot, { width: PAPER });
  }
}

function fromPaper() {
  for (const details of document.querySelectorAll("details[data-shut]")) {
    delete details.dataset.shut;
    details.open = false;
  }
  for (const { element } of papers) element.querySelector(".sheets")?.remove();
  for (const plot of plots()) Plotly.relayout(plot, { width: null, autosize: true });
}

const plots = () => document.querySelectorAll(".chart[data-drawn] > .plot");
addEventListener("beforeprint", toPaper);
addEventListener("afterprint", fromPaper);
