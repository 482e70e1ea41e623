// Each figure is drawn of the report's own data, as its pictures, tables and slides are.
JSON.parse(document.getElementById("report").textContent).figures.forEach(({ drawn: { data, layout } }, place) =>
  Plotly.newPlot(`figure-${place + 1}`, data, layout, { displaylogo: false, showSendToCloud: false, responsive: true }));
