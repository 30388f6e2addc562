"use strict";
// Shows what the stream says at /events: all of it on connecting, then what is new.

const NS = "http://www.w3.org/2000/svg";
const KEPT = { time: 1200, place: 2000 };
const SHOWN_EVENTS = 100;
const LEFT = 58, RIGHT = 6, TOP = 6, BOTTOM = 18, HEIGHT = 92;
const NO_PLACE = 1e4; // m: before the first fix the chainage counts from the start, and its sigma is 100 km
// Column, label, factor; for a logarithmic axis its range: less is drawn at its end, and more is not known and not drawn.
const STRIPS = {
  time: [
    ["speed_mps", "Speed, km/h", 3.6],
    ["chainage_m_sd", "1-sigma of the chainage, m (logarithmic)", 1, [0.01, NO_PLACE]],
    ["roll_rad", "Roll, deg", 180 / Math.PI],
    ["delay_s", "Delay from the newest row to its estimate, s", 1],
  ],
  place: [
    ["curvature_1pm", "Curvature, 1/km (left +)", 1000],
    ["cross_level_mm", "Cross-level, mm", 1],
    ["twist_mm", "Twist, mm", 1],
    ["level_mm", "Level, mm", 1],
    ["alignment_mm", "Alignment, mm", 1],
  ],
};

const data = { columns: {}, time: [], place: [], events: [], kinds: {}, done: null, ended: false };
let paused = false, dirty = false;
const byId = (id) => document.getElementById(id);

function take(message) {
  for (const part of ["time", "place"]) {
    data[part].push(...message[part]);
    data[part].splice(0, data[part].length - KEPT[part]);
  }
  data.events.push(...message.events);
  data.events.splice(0, data.events.length - SHOWN_EVENTS);
  Object.assign(data, { kinds: message.kinds, done: message.done, ended: message.ended });
  dirty = true;
}

function connect() {
  const source = new EventSource("/events");
  source.addEventListener("whole", (event) => {
    const message = JSON.parse(event.data);
    data.columns = message.columns;
    Object.assign(data, { time: [], place: [], events: [] });
    byId("title").textContent = message.about.title;
    document.title = message.about.title + " - trackfg stream";
    take(message.whole);
    say();
  });
  source.addEventListener("news", (event) => {
    take(JSON.parse(event.data));
    say();
  });
  // A stream that is over closes the connection; the page goes on asking, for one that begins again.
  source.onerror = () => {
    say(data.ended ? "the stream has ended" : "connection lost: trying again", !data.ended);
    if (source.readyState === EventSource.CLOSED) setTimeout(connect, 1000);
  };
}

function say(text, lost = false) {
  const share = data.done === null ? "" : `, ${Math.round(100 * data.done)} % of its source read`;
  const line = text || (data.ended ? "the stream has ended" : `running${share}`);
  const state = byId("state");
  if (state.textContent !== line) state.textContent = line;
  state.classList.toggle("lost", lost);
}

const format = (value, digits) => (value === null || value === undefined ? "not known" : fixed(value, digits));
const fixed = (value, digits) => value.toFixed(digits).replace(/^-(?=[0.]*$)/, ""); // no -0
const digitsFor = (span) => Math.max(0, Math.min(5, 1 - Math.floor(Math.log10(span || 1))));

function element(name, attributes, text) {
  const made = document.createElementNS(NS, name);
  for (const key in attributes) made.setAttribute(key, attributes[key]);
  if (text !== undefined) made.textContent = text;
  return made;
}

function strip(part, [name, label, scale, range]) {
  const columns = data.columns[part], at = columns.indexOf(name), sd = columns.indexOf(name + "_sd");
  const height = (value) => (range ? Math.log10(Math.max(value, range[0])) : value);
  const rows = data[part].filter((row) => row[at] !== null && !(range && scale * row[at] > range[1]));
  const points = rows.map((row) => [row[0], height(scale * row[at]), sd < 0 ? 0 : 1.96 * scale * (row[sd] || 0)]);
  const id = `strip-${part}-${name}`;
  let figure = byId(id);
  if (points.length < 2) { if (figure) figure.remove(); return; }
  if (!figure) {
    figure = document.createElement("figure");
    figure.id = id;
    figure.append(document.createElement("figcaption"), element("svg", { role: "img" }));
    byId(`over-${part}`).append(figure);
  }
  const svg = figure.querySelector("svg"), width = svg.clientWidth || 800;
  const xs = data[part].map((row) => row[0]).filter((x) => x !== null); // one axis for all strips of a part
  const x0 = Math.min(...xs), x1 = Math.max(...xs), span = x1 - x0 || 1;
  // The band of the middle nine tenths is in sight: a first guess may be ten times as wide.
  const widths = points.map((p) => p[2]).sort((a, b) => a - b), wide = widths[Math.floor(0.9 * (widths.length - 1))];
  let low = Math.min(...points.map((p) => p[1] - Math.min(p[2], wide)));
  let high = Math.max(...points.map((p) => p[1] + Math.min(p[2], wide)));
  if (high - low < 1e-9) { low -= 0.5; high += 0.5; }
  const back = (y) => (range ? 10 ** y : y);
  const written = (value, more) => fixed(value, digitsFor(range ? value : high - low) + more);
  const X = (x) => LEFT + (width - LEFT - RIGHT) * (x - x0) / span;
  const Y = (y) => Math.min(Math.max(TOP + (HEIGHT - TOP - BOTTOM) * (high - y) / (high - low), 0), HEIGHT - BOTTOM + 4);
  const path = (pairs) => pairs.map(([x, y], i) => `${i ? "L" : "M"}${X(x).toFixed(1)} ${Y(y).toFixed(1)}`).join("");
  const runs = unbroken(points, part);
  svg.setAttribute("viewBox", `0 0 ${width} ${HEIGHT}`);
  svg.replaceChildren();
  for (const y of roundNumbers(low, high, 4)) {
    svg.append(element("line", { class: "grid", x1: LEFT, x2: width - RIGHT, y1: Y(y), y2: Y(y) }));
    svg.append(element("text", { x: LEFT - 6, y: Y(y) + 4, "text-anchor": "end" }, written(back(y), 0)));
  }
  for (const x of roundNumbers(x0, x1, Math.max(2, Math.floor(width / 110)))) {
    svg.append(element("line", { class: "grid", x1: X(x), x2: X(x), y1: TOP, y2: HEIGHT - BOTTOM }));
    svg.append(element("text", { x: X(x), y: HEIGHT - 4, "text-anchor": "middle" }, fixed(x, span < 5 ? 1 : 0)));
  }
  for (const run of runs) {
    if (sd >= 0) {
      const up = run.map((p) => [p[0], p[1] + p[2]]), down = run.map((p) => [p[0], p[1] - p[2]]).reverse();
      svg.append(element("path", { class: "band", d: path(up.concat(down)) + "Z" }));
    }
    svg.append(element("path", { class: "curve", d: path(run) }));
  }
  const newest = scale * rows.at(-1)[at], band = points.at(-1)[2]; // both as fine as the band, which may be far below the axis
  const digits = Math.max(digitsFor(range ? newest : high - low) + 1, sd < 0 ? 0 : digitsFor(band));
  const text = `${label}: ${fixed(newest, digits)}${sd < 0 ? "" : ` ± ${fixed(band, digits)} (95 %)`}`;
  figure.querySelector("figcaption").textContent = text;
  svg.setAttribute("aria-label", `${text}; from ${written(back(low), 1)} to ${written(back(high), 1)} between ${x0.toFixed(0)} and ${x1.toFixed(0)} ${part === "time" ? "s" : "m"}`);
}

// Whole multiples of 1, 2 or 5 times a power of ten between two numbers, about so many.
function roundNumbers(low, high, count) {
  const rough = (high - low) / count, decade = 10 ** Math.floor(Math.log10(rough));
  const step = decade * [1, 2, 5, 10].find((size) => size * decade >= rough * 0.999);
  const found = [];
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; k++) found.push(k * step);
  return found;
}

// Pieces without a hole: a gap of more than ten steps is not bridged.
function unbroken(points, part) {
  const steps = points.slice(1).map((p, i) => Math.abs(p[0] - points[i][0])).sort((a, b) => a - b);
  const most = 10 * (steps[Math.floor(steps.length / 2)] || 1), runs = [[]];
  points.forEach((point, i) => {
    if (i && Math.abs(point[0] - points[i - 1][0]) > most) runs.push([]);
    runs[runs.length - 1].push(point);
  });
  return runs;
}

function now() {
  const columns = data.columns.time, row = data.time[data.time.length - 1];
  if (!row) return;
  const value = (name) => row[columns.indexOf(name)];
  const sd = (name, scale, digits) => { const s = value(name + "_sd"); return s === null ? null : `± ${(scale * s).toFixed(digits)}`; };
  const degrees = 180 / Math.PI, speed = value("speed_mps");
  const placed = value("chainage_m_sd") < NO_PLACE;
  const events = Object.values(data.kinds).reduce((a, b) => a + b, 0);
  const cells = [
    ["Time of the newest estimate", `${format(row[0], 1)} s`],
    [placed ? "Chainage" : "Distance from the start", `${format(value("chainage_m"), 2)} m`, placed ? sd("chainage_m", 1, 2) : "no fix yet"],
    ["Speed", `${format(speed === null ? null : 3.6 * speed, 1)} km/h`, sd("speed_mps", 3.6, 2)],
    ["Roll", `${format(value("roll_rad") === null ? null : degrees * value("roll_rad"), 2)}°`, sd("roll_rad", degrees, 3)],
    ["Delay", `${format(value("delay_s"), 2)} s`],
    ["Events", String(events)],
  ];
  byId("now").replaceChildren(...cells.map(([name, text, sigma]) => {
    const cell = document.createElement("div"), term = document.createElement("dt"), shown = document.createElement("dd");
    term.textContent = name;
    shown.textContent = text + " ";
    if (sigma) { const small = document.createElement("small"); small.textContent = sigma; shown.append(small); }
    cell.append(term, shown);
    return cell;
  }));
}

function events() {
  const kinds = Object.entries(data.kinds).map(([kind, count]) => `${count} ${kind}`).join(", ");
  byId("kinds").textContent = kinds || "none so far";
  byId("events").replaceChildren(...data.events.slice().reverse().map((event) => {
    const row = document.createElement("tr");
    const time = event.t_s === null ? "" : event.t_s.toFixed(1), place = event.chainage_m === null ? "" : event.chainage_m.toFixed(1);
    for (const text of [time, event.kind, place, event.text]) {
      const cell = document.createElement("td");
      cell.textContent = text;
      row.append(cell);
    }
    return row;
  }));
}

function draw() {
  if (!dirty || paused || !data.columns.time) return;
  dirty = false;
  now();
  for (const part of ["time", "place"]) STRIPS[part].forEach((one) => strip(part, one));
  byId("no-place").hidden = data.place.length > 1;
  events();
}

byId("pause").addEventListener("click", (event) => {
  paused = !paused;
  event.target.setAttribute("aria-pressed", String(paused));
  event.target.textContent = paused ? "Go on" : "Pause";
  draw();
});
addEventListener("resize", () => { dirty = true; draw(); });
setInterval(draw, 300);
connect();
