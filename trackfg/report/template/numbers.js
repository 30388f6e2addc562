// Numbers and places as the page writes them.

function number(value) {
  if (value === 0) return "0";
  const size = Math.floor(Math.log10(Math.abs(value)));
  return size < -4 || size > 6 ? value.toExponential(3) : value.toFixed(Math.max(3 - size, 0));
}

/** The official place, m, as 12+345.6 or 12.3456; beyond the next post metres count on from the old one. */
function written(official, [, , , , post], plus, decimals) {
  if (!plus) return (official / 1000).toFixed(Math.max(decimals + 3, 1));
  const rounded = Number(official.toFixed(decimals));
  const km = post !== null && rounded >= 1000 * (post + 1) ? post : Math.floor(rounded / 1000);
  const metres = rounded - 1000 * km;
  return `${km}+${metres.toFixed(decimals).padStart(decimals ? decimals + 4 : 3, "0")}`;
}

/** The stretch of the official axis that a place lies on. */
function stretchAt({ stretches }, x) {
  return stretches.findLast(([from]) => from <= x) ?? stretches[0];
}

/** A place of a chart's axis in words. */
function placeText(chart, x) {
  if (chart.official === null) {
    return `${chart.x.label.replace(/,.*/, "")} ${x.toFixed(chart.x.unit === "km" ? 4 : 2)} ${chart.x.unit}`;
  }
  const stretch = stretchAt(chart.official, x), [, at, official, rate] = stretch;
  return `km ${written(official + rate * (x - at), stretch, chart.official.plus, 1)}`;
}

/** Round places of an axis, about so many, and two or more: where they are and what is written there. */
function ticks(chart, range, count) {
  const found = roundPlaces(chart, range, count);
  return found.length < 2 && count < 20 ? ticks(chart, range, 2 * count) : found;
}

function roundPlaces(chart, [from, to], count) {
  const round = (rough) => {
    const decade = 10 ** Math.floor(Math.log10(rough));
    return decade * [1, 2, 5, 10].find((size) => size * decade >= rough * .999);
  };
  const found = [];
  if (chart.official === null) {
    const step = round((to - from) / count), digits = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
    for (let k = Math.ceil(from / step - 1e-9); k * step <= to + 1e-9 * step; k++) {
      found.push([k * step, (k * step).toFixed(digits)]);
    }
    return found;
  }
  const { stretches, plus } = chart.official;
  stretches.forEach((stretch, i) => {
    const [start, at, official, rate] = stretch;
    const low = Math.max(i === 0 ? from : start, from), high = Math.min(stretches[i + 1]?.[0] ?? to, to);
    if (high <= low) return;
    const step = round(Math.abs(rate) * (to - from) / count), decimals = step < 1 ? 1 : 0;
    const ends = [low, high].map((x) => official + rate * (x - at)).sort((a, b) => a - b);
    for (let k = Math.ceil(ends[0] / step - 1e-9); k * step <= ends[1] + 1e-9; k++) {
      found.push([at + (k * step - official) / rate, written(k * step, stretch, plus, decimals)]);
    }
  });
  return found.sort((a, b) => a[0] - b[0]);
}
