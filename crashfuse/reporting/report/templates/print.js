// Paper is narrower than the window, and a page shorter than a stack of figures; afterwards all is as it was.
const figures = () => document.querySelectorAll(".plotly-graph-div");
const resize = (figure, layout) => {
  Plotly.relayout(figure, layout);
  figure.parentElement.style.height = `${layout.height}px`;
};
addEventListener("beforeprint", () => figures().forEach(figure => {
  figure.dataset.height = figure.layout.height;
  resize(figure, { autosize: false, width: 680, height: Math.min(figure.layout.height, 600) });
}));
addEventListener("afterprint", () => figures().forEach(figure => {
  resize(figure, { autosize: true, width: null, height: Number(figure.dataset.height) });
}));
