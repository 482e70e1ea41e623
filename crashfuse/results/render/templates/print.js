// On paper figures are narrower and lower, with smaller words, so that two or three fit a page; afterwards all is as it was.
const WIDTH_PX = 680, SHARE = 0.4, SHARE_IN_DOSSIER = 0.8, SHARE_OF_FEW = 0.5, FEW = 3, LOWEST_PX = 225, ROW_PX = 24, WORDS_PX = 11, IN_CELLS_PX = 9;
const MARGINS_PX = 110, LETTER_PX = 6, PANEL_PX = 90;
const before = new Map();
const figures = () => document.querySelectorAll(".plotly-graph-div");
const cells = figure => figure.data.flatMap((trace, number) => trace.type === "heatmap" ? [number] : []);
const relaid = (figure, changes, height, inCellsPx) => {
  const some = inCellsPx.length > 0;
  Plotly.update(figure, some ? { "textfont.size": inCellsPx } : {}, changes, some ? cells(figure) : undefined);
  figure.style.height = `${height}px`;
};
const wrapped = (text, most) => text.replaceAll("<br>", " ").split(" ").reduce((lines, word) => {
  const longer = `${lines.at(-1)} ${word}`.trim();
  return longer.length > most && lines.at(-1) ? [...lines, word] : [...lines.slice(0, -1), longer];
}, [""]).join("<br>");
const underNames = data => { // a row of names above a figure takes space from its curves
  const names = new Set(data.filter(trace => trace.name && trace.showlegend !== false).map(trace => trace.name));
  const length = [...names].reduce((sum, name) => sum + name.length * LETTER_PX + 45, 0);
  return 20 * Math.max(Math.ceil(length / 560) - 2, 0);
};
const heightOfCells = (cells, data) => { // their heads may have several lines, and names may stand below
  const lines = Math.max(...cells.x.map(head => head.split("<br>").length));
  const names = data.some(trace => trace.name && trace.showlegend !== false) ? 44 : 0;
  return cells.y.length * ROW_PX + 34 + 15 * lines + names;
};
const panels = layout => Object.keys(layout).filter(key => key.startsWith("yaxis")).length; // above each other
const onPaper = figure => {
  const { layout, data } = figure, usual = layout.height;
  const changes = { autosize: false, width: WIDTH_PX };
  const share = document.querySelector(".dossier") ? SHARE_IN_DOSSIER // its figures stand for themselves
    : figures().length <= FEW ? SHARE_OF_FEW : SHARE;
  const heatMap = data.find(trace => trace.type === "heatmap");
  const rows = heatMap ? heightOfCells(heatMap, data) : Math.max(usual * share, LOWEST_PX, MARGINS_PX + PANEL_PX * panels(layout)) + underNames(data);
  Object.assign(changes, { height: Math.round(Math.min(usual, rows)), "font.size": WORDS_PX });
  for (const key of Object.keys(layout).filter(key => /^[xy]axis/.test(key) && layout[key].title?.text)) {
    const [low, high] = layout[key].domain ?? [0, 1], length = (changes.height - MARGINS_PX) * (high - low);
    const title = wrapped(layout[key].title.text, length / LETTER_PX), longest = Math.max(...title.split("<br>").map(line => line.length));
    if (key.startsWith("y")) changes[`${key}.title.text`] = title;
    changes[`${key}.title.font.size`] = key.startsWith("y") ? Math.max(8, Math.min(WORDS_PX, length / longest / 0.66)) : WORDS_PX;
  }
  const sizes = Object.keys(changes).filter(key => /^y.*title\.font/.test(key)), least = Math.min(...sizes.map(key => changes[key]));
  sizes.forEach(key => changes[key] = least); // panels above each other have titles of one size
  return changes;
};
const kept = (figure, changes) => Object.fromEntries(Object.keys(changes).map(path =>
  [path, path.split(".").reduce((part, key) => part?.[key], figure.layout) ?? null]));
addEventListener("beforeprint", () => figures().forEach(figure => {
  const changes = onPaper(figure), inCellsPx = cells(figure).map(number => figure.data[number].textfont?.size ?? null);
  before.set(figure, { usual: kept(figure, changes), inCellsPx });
  relaid(figure, changes, changes.height, inCellsPx.map(() => IN_CELLS_PX));
}));
addEventListener("afterprint", () => before.forEach(({ usual, inCellsPx }, figure) => {
  relaid(figure, { ...usual, autosize: true, width: null }, usual.height, inCellsPx);
  before.delete(figure);
}));
