// Writes the data of a figure as CSV: a row a point, with its panel and its curve; a band is two curves.
function rowsOf(figure) {
  const { data, layout } = specification(figure);
  const headings = Object.fromEntries((layout.annotations || []).map((note) => [note.xref.split(" ")[0], note.text]));
  const rows = [["panel", "curve", "x", "y"]];
  for (const trace of data) {
    const panel = headings[trace.xaxis || "x"] || "", name = trace.name || trace.meta || "";
    const half = trace.fill === "toself" ? trace.x.length / 2 : trace.x.length;
    trace.x.forEach((x, k) => {
      const curve = trace.fill === "toself" ? `${name}, ${k < half ? "lower" : "upper"} end` : name;
      rows.push([panel, curve, x, trace.y[k]]);
    });
  }
  return rows;
}

const quoted = (value) => {
  const text = value === null || value === undefined ? "" : String(value);
  return /[",\n]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text;
};
const csvOf = (figure) => rowsOf(figure).map((row) => row.map(quoted).join(",")).join("\r\n") + "\r\n";

document.querySelectorAll("button.csv").forEach((button) => button.addEventListener("click", () => {
  const figure = button.closest("figure").querySelector(".figure");
  const link = document.createElement("a");
  link.href = URL.createObjectURL(new Blob([csvOf(figure)], { type: "text/csv" }));
  link.download = `${figure.getAttribute("aria-label").replace(/[^\w.]+/g, "-")}.csv`;
  link.click();
  URL.revokeObjectURL(link.href);
}));
