// The triangles beside entries of the navigation have a name for readers of the screen.
document.addEventListener("DOMContentLoaded", () => {
  for (const toggle of document.querySelectorAll("summary > .toctree-toggle")) {
    const entry = toggle.closest("li")?.querySelector("a");
    toggle.parentElement.setAttribute("aria-label", `pages below ${entry?.textContent.trim() ?? "this one"}`);
  }
});
