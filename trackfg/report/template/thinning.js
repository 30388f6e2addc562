// Long curves thinned to the pixels of their panel.

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
