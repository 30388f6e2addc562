"use strict";
// Keeps the texts of a served page that change, and says where it has more to show.
(() => {
  const PAUSE_MS = 1000;

  async function ask(element) {
    let answer = null;
    try {
      answer = await (await fetch(element.dataset.address)).json();
    } catch { // the server has ended, or the connection is lost: it is asked again
      answer = { text: "no connection to trackfg browse", reload: false };
    }
    const shown = JSON.stringify(answer);
    if (element.dataset.shown !== shown) {
      element.dataset.shown = shown;
      element.textContent = answer.text + " ";
      if (answer.reload) {
        const link = document.createElement("a");
        link.href = location.href;
        link.textContent = "show what is new";
        element.append(link);
      }
    }
    setTimeout(() => ask(element), PAUSE_MS);
  }

  for (const element of document.querySelectorAll(".latest")) ask(element);
})();
