// Below each figure: save it as SVG or PNG. Below each table: copy it, with tabs between cells, as spreadsheets paste.
const button = (label, title, act) => {
  const made = Object.assign(document.createElement("button"), { type: "button", textContent: label, title });
  made.addEventListener("click", () => act(made));
  return made;
};
const below = (element, ...buttons) => {
  const row = Object.assign(document.createElement("div"), { className: "tools" });
  row.append(...buttons);
  element.after(row);
};
const named = figure => { // by the headings above it
  const above = tag => [...document.querySelectorAll(tag)]
    .filter(heading => heading.compareDocumentPosition(figure) & Node.DOCUMENT_POSITION_FOLLOWING).at(-1);
  const [outer, inner] = ["h2", "h3"].map(above), closer = Node.DOCUMENT_POSITION_FOLLOWING;
  const inside = outer && inner && outer.compareDocumentPosition(inner) & closer ? [inner] : [];
  const words = [outer?.textContent.split(": ")[0], ...inside.map(heading => heading.textContent), figure.id];
  return words.join(" ").trim().replace(/[^\w.-]+/g, "-");
};
const save = (figure, format) => Plotly.downloadImage(figure, {
  format, filename: named(figure),
  width: figure.clientWidth, height: figure.layout.height, scale: format === "png" ? 3 : 1,
});
const copy = async (text, pressed) => {
  try {
    await navigator.clipboard.writeText(text);
  } catch { // a page that is not secure, or a browser that refuses
    const area = Object.assign(document.createElement("textarea"), { value: text });
    pressed.after(area);
    area.select();
    document.execCommand("copy");
    area.remove();
  }
  pressed.textContent = "Copied";
  setTimeout(() => { pressed.textContent = "Copy"; }, 1500);
};
addEventListener("DOMContentLoaded", () => {
  for (const figure of document.querySelectorAll(".plotly-graph-div")) {
    below(figure.parentElement, ...["svg", "png"].map(format =>
      button(format.toUpperCase(), `Save this figure as ${format.toUpperCase()}`, () => save(figure, format))));
  }
  for (const table of document.querySelectorAll("table[data-copy]")) {
    below(table, button("Copy", "Copy this table for a spreadsheet", pressed => copy(table.dataset.copy, pressed)));
  }
});
