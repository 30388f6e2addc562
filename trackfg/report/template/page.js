// All charts and tables of the page.

async function drawFigure(element, chart) {
  const plot = document.createElement("div");
  plot.className = "plot";
  element.append(plot);
  await window.plotlyLoaded;
  const clear = { paper_bgcolor: "rgba(255,255,255,0)", plot_bgcolor: "rgba(255,255,255,0)" };
  await Plotly.newPlot(plot, chart.traces, { font: FONT, ...clear, ...chart.layout, height: chart.height }, CONFIG);
}

async function draw(element) {
  const chart = spec.charts[Number(element.dataset.chart)], strips = chart.kind === "strips";
  try {
    await (strips ? drawStrips : drawFigure)(element, chart);
    const plot = element.querySelector(".plot");
    plot.setAttribute("aria-label", element.dataset.alternative);
    plot.setAttribute("role", strips ? "application" : "img");
    if (strips) plot.tabIndex = 0;
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

function redraw(element) {
  const old = papers.findIndex((one) => one.element === element);
  if (old >= 0) papers.splice(old, 1);
  Plotly.purge(element.querySelector(".plot"));
  element.replaceChildren();
  delete element.dataset.drawn;
  draw(element);
}

const pause = () => new Promise((resolve) => setTimeout(resolve, 0));

async function main() {
  const hidden = (element) => element.closest("details:not([open])") !== null;
  for (const details of document.querySelectorAll("details")) {
    details.addEventListener("toggle", () => {
      for (const element of details.querySelectorAll(".chart:empty")) draw(element);
    });
  }
  for (const table of document.querySelectorAll("main .table > table")) withTools(table);
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
