// Paper is narrower than the window, and a page shorter than a stack of figures; afterwards all is as it was.
const figures = () => document.querySelectorAll(".plotly-graph-div");
addEventListener("beforeprint", () => figures().forEach(figure => {
  figure.dataset.height = figure.layout.height;
  Plotly.relayout(figure, { autosize: false, width: 680, height: Math.min(figure.layout.height, 600) });
}));
addEventListener("afterprint", () => figures().forEach(figure => {
  Plotly.relayout(figure, { autosize: true, width: null, height: Number(figure.dataset.height) });
}));
