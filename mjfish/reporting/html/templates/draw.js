// Draws every figure from the specification inside it; again when the colours change.
(() => {
  const config = { displayModeBar: false, responsive: true };
  const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
  const read = (text) => JSON.parse(text, (_key, value) =>
    typeof value === "string" && value.startsWith("@") ? colour(value.slice(1)) : value);
  const draw = (figure) => {
    const closed = figure.closest("details:not([open])");
    if (closed) return;
    const spec = read(figure.querySelector("script").textContent);
    let canvas = figure.querySelector(".canvas");
    if (!canvas) {
      canvas = document.createElement("div");
      canvas.className = "canvas";
      figure.append(canvas);
    }
    Plotly.react(canvas, spec.data, spec.layout, config);
  };
  const figures = [...document.querySelectorAll(".figure")];
  const drawAll = () => figures.forEach(draw);
  document.querySelectorAll("details").forEach((details) =>
    details.addEventListener("toggle", () => details.querySelectorAll(".figure").forEach(draw)));
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", drawAll);
  addEventListener("beforeprint", () => {
    document.documentElement.classList.add("paper");
    document.querySelectorAll("details").forEach((details) => { details.open = true; });
    drawAll();
  });
  addEventListener("afterprint", () => {
    document.documentElement.classList.remove("paper");
    drawAll();
  });
  drawAll();
})();
