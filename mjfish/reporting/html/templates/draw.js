// Draws every figure from the specification inside it; again when the colours or the width of the page change.
"use strict";
document.documentElement.classList.add("scripted");
const NARROW = matchMedia("(max-width: 640px)");
// Pixels of a panel, and between panels, where they stand below each other.
const PANEL = 150, BETWEEN = 62;

const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
const specification = (figure) => JSON.parse(figure.querySelector("script").textContent, (_key, value) =>
  typeof value === "string" && value.startsWith("@") ? colour(value.slice(1)) : value);

// Puts panels that stand side by side below each other, column by column.
function stack(layout) {
  const panels = Object.keys(layout).filter((key) => /^xaxis\d*$/.test(key) && layout[key].domain)
    .map((key) => ({ x: layout[key], y: layout[key.replace("x", "y")] }));
  if (new Set(panels.map(({ x }) => x.domain[0])).size < 2) return;
  panels.sort((a, b) => a.x.domain[0] - b.x.domain[0] || b.y.domain[0] - a.y.domain[0]);
  const each = PANEL + BETWEEN, height = panels.length * each - BETWEEN;
  panels.forEach(({ x, y }, k) => {
    x.domain = [0, 1];
    y.domain = [1 - (k * each + PANEL) / height, 1 - (k * each) / height];
  });
  layout.height = height + layout.template.layout.margin.t + layout.template.layout.margin.b;
}

function drawFigure(figure) {
  if (figure.closest("details:not([open]), [hidden]")) return;
  const spec = specification(figure);
  if (NARROW.matches) stack(spec.layout);
  let canvas = figure.querySelector(".canvas");
  if (!canvas) {
    canvas = document.createElement("div");
    canvas.className = "canvas";
    figure.append(canvas);
  }
  Plotly.react(canvas, spec.data, spec.layout, { displayModeBar: false, responsive: true });
}

const drawIn = (element) => element.querySelectorAll(".figure").forEach(drawFigure);
const drawAll = () => drawIn(document);

document.querySelectorAll("details").forEach((details) => details.addEventListener("toggle", () => drawIn(details)));
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", drawAll);
NARROW.addEventListener("change", drawAll);
addEventListener("beforeprint", () => {
  document.documentElement.classList.add("paper");
  document.querySelectorAll("details:not(.reading)").forEach((details) => { details.open = true; });
  document.querySelectorAll(".choice").forEach((choice) => { choice.hidden = false; });
  drawAll();
});
addEventListener("afterprint", () => {
  document.documentElement.classList.remove("paper");
  document.querySelectorAll("select[data-picks]").forEach(pick);
  drawAll();
});
