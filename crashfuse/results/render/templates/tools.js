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
const save = (figure, format) => Plotly.downloadImage(figure, {
  format, filename: figure.dataset.name,
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
