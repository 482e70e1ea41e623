// The camera of Plotly draws the image, with its settings when it is pressed. Its words have the room that they take in
// the page's font, which other programs do not have: so the font goes with them, and their lengths are written down.
const SHARP = 3, WAIT_MS = 30000;
const lit = (part, light) => {  // with the parts that differ on a light page
  if (light === null || typeof light !== "object" || Array.isArray(light)) return light;
  const copy = Array.isArray(part) ? [...part] : { ...part };
  for (const name in light) copy[name] = lit(part[name], light[name]);
  return copy;
};
const drawn = (figure, { data, layout }, filename) => new Promise((resolve, reject) => {
  const url = URL.createObjectURL, click = HTMLAnchorElement.prototype.click;
  let taken;
  const restore = () => {
    clearTimeout(never);
    URL.createObjectURL = url;
    HTMLAnchorElement.prototype.click = click;
  };
  const never = setTimeout(() => { restore(); reject(); }, WAIT_MS);
  URL.createObjectURL = blob => url.call(URL, taken = blob);
  HTMLAnchorElement.prototype.click = function () {
    if (this.download !== `${filename}.svg`) return click.call(this);
    restore();
    resolve(taken.text());
  };
  Object.assign(figure._context.toImageButtonOptions, { format: "svg", filename, scale: 1 });
  const tools = [...figure.querySelectorAll(".modebar-btn")], onPage = { data: figure.data, layout: figure.layout };
  Object.assign(figure, { data, layout });  // which are copied at the click
  tools.find(tool => /download plot/i.test(tool.dataset.title ?? ""))?.click();
  Object.assign(figure, onPage);
});
const address = blob => new Promise(resolve => {
  const reader = new FileReader();
  reader.onload = () => resolve(reader.result);
  reader.readAsDataURL(blob);
});
const font = async () => {
  const rules = [...document.styleSheets].flatMap(sheet => {
    try { return [...sheet.cssRules]; } catch { return []; }
  });
  const rule = rules.find(({ style }) =>
    /^["']?Source Sans["']?$/.test(style?.fontFamily ?? "") && style.src && style.fontStyle !== "italic");
  if (!rule) return "";
  const [, source] = rule.style.src.match(/url\(["']?([^"')]+)/);
  const file = await fetch(new URL(source, rule.parentStyleSheet.href ?? location.href));
  const data = await address(await file.blob());
  return `@font-face { font-family: "Source Sans"; font-weight: 200 900; src: url(${data}) }`;
};
const EDGE = 12, WEIGHTS = { title: 600, details: 400 }, SIZES = { title: 17, details: 13 };
const headed = (svg, { font, paper_bgcolor: paper }, said) => {  // its caption, wrapped, in a space above it
  const [width, height] = ["width", "height"].map(side => +svg.getAttribute(side));
  const make = (name, own) => {
    const made = document.createElementNS(svg.namespaceURI, name);
    for (const [key, value] of Object.entries(own)) made.setAttribute(key, value);
    return made;
  };
  const head = make("g", { "font-family": font.family, fill: font.color });
  const body = make("g", {});
  body.append(...svg.childNodes);
  svg.append(make("rect", { width: "100%", height: "100%", fill: paper }), head, body);
  let y = EDGE;
  for (const [kind, size] of Object.entries(SIZES)) {
    let line;
    for (const word of said[kind].split(" ").filter(Boolean)) {
      const before = line?.textContent;
      if (line) line.textContent += ` ${word}`;
      if (line && line.getComputedTextLength() <= width - 2 * EDGE) continue;
      if (line) line.textContent = before;
      y += 1.3 * size;
      line = make("text", { x: EDGE, y, "font-size": size, "font-weight": WEIGHTS[kind] });
      head.append(line);
      line.textContent = word;
    }
  }
  y += EDGE;
  body.setAttribute("transform", `translate(0 ${y})`);
  svg.setAttribute("height", height + y);
  svg.setAttribute("viewBox", `0 0 ${width} ${height + y}`);
};
const picture = async (figure, said) => {
  const light = lit({ data: figure.data, layout: figure.layout }, said.light);
  const svg = new DOMParser().parseFromString(await drawn(figure, light, said.name), "image/svg+xml").documentElement;
  const room = document.createElement("div");
  room.style.cssText = "position: absolute; visibility: hidden";
  room.append(svg);
  document.body.append(room);
  headed(svg, light.layout, said);
  for (const words of svg.querySelectorAll("text, tspan")) {
    if (words.children.length || !words.textContent.trim()) continue;
    words.setAttribute("textLength", words.getComputedTextLength());
    words.setAttribute("lengthAdjust", "spacingAndGlyphs");
  }
  room.remove();
  const style = document.createElementNS(svg.namespaceURI, "style");
  style.textContent = await font();
  svg.prepend(style);
  return new Blob([new XMLSerializer().serializeToString(svg)], { type: "image/svg+xml" });
};
const sharp = async blob => {
  const image = new Image();
  image.src = await address(blob);
  await image.decode();
  const canvas = document.createElement("canvas");
  [canvas.width, canvas.height] = [image.width * SHARP, image.height * SHARP];
  canvas.getContext("2d").drawImage(image, 0, 0, canvas.width, canvas.height);
  return new Promise(resolve => canvas.toBlob(resolve));
};
const save = (blob, name) => {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(blob);
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
};
const STEP = 0.01, WIDE = 0.1, taken = new WeakMap();
const point = (area, figure, kind) => {
  const box = area.getBoundingClientRect(), [right, down] = figure.cursor;
  const place = { clientX: box.left + right * box.width, clientY: box.top + down * box.height, bubbles: true };
  area.dispatchEvent(new MouseEvent(kind, { ...place, view: window, cancelable: true }));
};
const areaOf = figure => figure.matches?.(".js-plotly-plot") && figure.querySelector(".nsewdrag");
const leave = event => {
  const figure = event.target, area = areaOf(figure);
  if (area && figure.cursor) point(area, figure, "mouseout");
};
const follow = (from, tries) => {  // a page that a click opened gets the focus, which was lost with the figure
  const title = document.querySelector('[data-testid="stMain"] h1');
  if (location.pathname === from || !title || document.querySelector(".js-plotly-plot:focus")) {
    if (tries) setTimeout(follow, 200, from, tries - 1);
  } else if (document.activeElement === document.body) {
    title.tabIndex = -1;
    title.focus();
  }
};
const press = event => {
  const figure = event.target, area = areaOf(figure);
  if (!area || event.ctrlKey || event.altKey || event.metaKey) return;
  const moves = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
  figure.cursor ??= [0.5, 0.5];
  if (event.key in moves) {
    const cells = figure._fullData?.find(trace => trace.type === "heatmap");
    const within = at => Math.min(Math.max(at, 0.005), 0.995);
    figure.cursor = figure.cursor.map((at, axis) => {
      const move = moves[event.key][axis], n = [cells?.x, cells?.y][axis]?.length;  // from cell to cell, if it has any
      if (n) return (Math.min(Math.max(Math.floor(at * n) + move, 0), n - 1) + 0.5) / n;
      return within(at + move * (event.shiftKey ? WIDE : STEP));
    });
    point(area, figure, "mousemove");
  } else if (event.key === "Enter") {
    for (const kind of ["mousemove", "mousedown", "mouseup"]) point(area, figure, kind);
    follow(location.pathname, 50);
  } else if (event.key === "Escape") {
    leave(event);
  } else {
    return;
  }
  event.preventDefault();
};
const reachable = () => {
  for (const figure of document.querySelectorAll(".js-plotly-plot:not([tabindex])")) {
    figure.tabIndex = 0;
    figure.setAttribute("aria-keyshortcuts", "ArrowLeft ArrowRight ArrowUp ArrowDown Enter Escape");
  }
};
if (!window.crashfuseKeys) {  // once for all figures, also those that are drawn later
  window.crashfuseKeys = true;
  document.addEventListener("keydown", press);
  document.addEventListener("focusout", leave);
  setInterval(reachable, 1000);
}
const nearest = host => [...document.querySelectorAll(".js-plotly-plot")]
  .filter(figure => figure.compareDocumentPosition(host) & Node.DOCUMENT_POSITION_FOLLOWING).at(-1);
export default ({ parentElement, data, setTriggerValue }) => {
  const host = parentElement.host ?? parentElement;
  for (const button of parentElement.querySelectorAll("button")) {
    button.onclick = async () => {
      const figure = nearest(host), format = button.dataset.format;
      if (!figure?._fullData) return;
      if (format === "csv") {
        const hidden = figure._fullData.filter(trace => trace.visible !== true).map(trace => trace.index);
        setTriggerValue("csv", { hidden, at: Date.now() });
        return;
      }
      const svg = await picture(figure, data);
      save(format === "png" ? await sharp(svg) : svg, `${data.name}.${format}`);
    };
  }
  if (data.csv && taken.get(parentElement) !== data.at) {
    taken.set(parentElement, data.at);
    save(new Blob([data.csv], { type: "text/csv" }), `${data.name}.csv`);
  }
};
