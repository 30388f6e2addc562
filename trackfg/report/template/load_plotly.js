"use strict";
// Unpacks plotly.js, which the page holds packed, and runs it; the page's policy names it by its hash.
window.plotlyLoaded = (async () => {
  const text = atob(document.getElementById("plotly").textContent);
  const bytes = Uint8Array.from(text, (letter) => letter.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  const script = document.createElement("script");
  script.textContent = await new Response(stream).text();
  document.head.append(script);
})();
