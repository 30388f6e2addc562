// The long columns of numbers.

const spec = JSON.parse(document.getElementById("spec").textContent);

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
