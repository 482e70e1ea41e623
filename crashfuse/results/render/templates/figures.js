// Each figure is drawn of the report's own data, as its pictures, tables and slides are.
JSON.parse(document.getElementById("report").textContent).figures.forEach(({ drawn: { data, layout } }, place) =>
  document.getElementById(`figure-${place + 1}`) && // slides may have more
  Plotly.newPlot(`figure-${place + 1}`, data, layout, { displaylogo: false, showSendToCloud: false, responsive: true }));
