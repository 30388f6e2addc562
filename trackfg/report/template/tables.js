// Tables are sorted by a click on a heading, filtered by words, and copied as CSV.

const FEW = 6; // rows of a table that needs no filter
const PLACE = /^-?\d+\+\d/;

/** What a cell is sorted by: a place as 12+345.6 or a number, otherwise its text. */
function sortKey(text) {
  if (PLACE.test(text)) {
    const [km, metres] = text.split("+");
    return 1000 * Number(km) + parseFloat(metres);
  }
  const value = parseFloat(text);
  return Number.isNaN(value) ? text : value;
}

/** Cells without a number come last, numbers before texts. */
function compared(a, b, sign) {
  const none = (key) => key === "–" || key === "";
  if (none(a) || none(b)) return none(a) - none(b);
  if (typeof a === "number" && typeof b === "number") return sign * (a - b);
  return sign * String(a).localeCompare(String(b), undefined, { numeric: true });
}

const cellsOf = (row) => [...row.cells].map((cell) => cell.textContent.trim());

function csv(table) {
  const quoted = (text) => /[",\n]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text;
  const rows = [table.tHead.rows[0], ...[...table.tBodies[0].rows].filter((row) => !row.hidden)];
  return rows.map((row) => cellsOf(row).map(quoted).join(",")).join("\n") + "\n";
}

async function copied(text) {
  try {
    await navigator.clipboard.writeText(text);
  } catch { // not allowed to this page: as it was done before there was a clipboard
    const area = document.createElement("textarea");
    area.value = text;
    document.body.append(area);
    area.select();
    document.execCommand("copy");
    area.remove();
  }
}

function sortable(table) {
  const body = table.tBodies[0], headings = [...table.tHead.rows[0].cells], first = [...body.rows];
  headings.forEach((heading, i) => {
    const text = heading.textContent, turn = button(text, () => {
      const sign = heading.ariaSort === "ascending" ? -1 : heading.ariaSort === "descending" ? 0 : 1;
      for (const other of headings) other.ariaSort = "none";
      heading.ariaSort = ["descending", "none", "ascending"][sign + 1];
      const keys = new Map(first.map((row) => [row, sortKey(row.cells[i].textContent.trim())]));
      body.append(...(sign === 0 ? first : [...first].sort((a, b) => compared(keys.get(a), keys.get(b), sign))));
    });
    heading.ariaSort = "none";
    heading.replaceChildren(turn);
  });
}

function withTools(table) {
  const rows = [...table.tBodies[0].rows], line = document.createElement("div"), said = document.createElement("output");
  const grouped = rows.some((row) => row.classList.contains("group"));
  if (rows.length > 1 && !grouped) sortable(table);
  line.className = "tabletools";
  if (table.caption) {
    const title = document.createElement("strong");
    title.textContent = table.caption.textContent;
    title.ariaHidden = "true"; // it is the table's caption, which readers of the screen get there
    table.caption.classList.add("above");
    line.append(title);
  }
  if (rows.length > FEW) {
    const field = document.createElement("input");
    field.type = "search";
    field.placeholder = "filter rows";
    field.setAttribute("aria-label", `filter the rows of ${table.caption?.textContent ?? "this table"}`);
    field.addEventListener("input", () => {
      const words = field.value.toLowerCase().split(/\s+/).filter((word) => word);
      let shown = 0;
      for (const row of rows) {
        const text = row.textContent.toLowerCase();
        row.hidden = !words.every((word) => text.includes(word));
        shown += !row.hidden;
      }
      said.textContent = words.length ? `${shown} of ${rows.length} rows` : "";
    });
    line.append(field);
  }
  if (rows.length) line.append(button("copy as CSV", async () => {
    await copied(csv(table));
    said.textContent = "copied";
  }), said);
  table.parentElement.before(line);
}
