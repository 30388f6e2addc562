// The axis that stays in sight, with the rows of curves, stations, fixes and events beside it.

const SVG = "http://www.w3.org/2000/svg";
const ROW = 17, TICKS = 20, LETTER = 6.4;

function svg(name, attributes = {}, text = null) {
  const made = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  if (text !== null) made.textContent = text;
  return made;
}

const SYMBOLS = { // around (0, 0)
  fix: "M-5,-5H5L0,5Z", station: "M-5,5V-1L0,-6L5,-1V5Z", standstill: "M-4,-4H4V4H-4Z", slip: "M0,-6L5,5H-5Z",
  gap: "M-5,-2H5V2H-5Z", exceeded: "M-1.5,-6H1.5V6H-1.5Z", other: "M0,-5L5,0L0,5L-5,0Z",
};

/** A place of a row: a stretch as a bar with its text where there is room, a point as a symbol. */
function placeMark([start, end, text, kind], at, low, high, y) {
  const group = svg("g", { class: `place ${kind}` });
  group.append(svg("title", {}, text));
  const a = Math.max(at(start), low), b = Math.min(at(end), high);
  if (b - a >= 4) {
    const turn = kind === "left" ? -3 : kind === "right" ? 3 : 0;
    group.append(svg("rect", { x: a, y: y - 5 + turn, width: b - a, height: 10 }));
    const short = text.replace(/^(\d+: R \d+).*/, "$1");
    if (short.length * LETTER < b - a) {
      group.append(svg("text", { x: (a + b) / 2, y: y + 3.6 + turn, "text-anchor": "middle" }, short));
    }
  } else {
    group.append(svg("path", { d: SYMBOLS[kind] ?? SYMBOLS.other, transform: `translate(${(a + b) / 2},${y})` }));
  }
  return group;
}

/** Rows of places and the ticks below them, into a group of that width; returns its height. */
function drawAxis(group, chart, range, left, width) {
  const [from, to] = range, at = (x) => left + width * (x - from) / (to - from), air = (to - from) / width;
  chart.places.forEach(({ name, places }, i) => {
    const y = ROW * i + ROW / 2;
    group.append(svg("text", { x: left - 10, y: y + 4, "text-anchor": "end", class: "row" }, left > 60 ? name : name.slice(0, 5)));
    for (const place of places) {
      if (place[1] >= from - air && place[0] <= to + air) group.append(placeMark(place, at, left, left + width, y));
    }
  });
  const base = ROW * chart.places.length + 2;
  group.append(svg("line", { x1: left, x2: left + width, y1: base, y2: base, class: "base" }));
  let taken = -Infinity;
  for (const [x, text] of ticks(chart, range, Math.max(3, Math.floor(width / 90)))) {
    group.append(svg("line", { x1: at(x), x2: at(x), y1: base, y2: base + 5, class: "base" }));
    const half = text.length * LETTER / 2;
    if (at(x) - half < taken + 6) continue;
    taken = at(x) + half;
    const room = Math.min(Math.max(at(x), left - 20 + half), left + width + 24 - half);
    group.append(svg("text", { x: room, y: base + 16, "text-anchor": "middle" }, text));
  }
  const unit = chart.official === null ? chart.x.unit : "km";
  group.append(svg("text", { x: left - 28, y: base + 16, "text-anchor": "end", class: "row" }, unit));
  return base + TICKS;
}

/** The axis of a chart, to stay in sight above it. */
function axisHead(chart, range, left, width, whole) {
  const drawing = svg("svg", { class: "axis", width: whole, role: "presentation", "aria-hidden": "true" });
  const height = drawAxis(drawing, chart, range, left, width);
  drawing.setAttribute("height", height);
  drawing.setAttribute("viewBox", `0 0 ${whole} ${height}`);
  return drawing;
}
