"use strict";
// Hands every chart's specification and data to vega-embed. Colours are CSS variables, so that light, dark and print
// follow the page.
(async () => {
  const report = JSON.parse(document.getElementById("report-data").textContent);
  const failed = [];
  for (const element of document.querySelectorAll("[data-chart]")) {
    const chart = report.charts[element.dataset.chart];
    const datasets = {};
    for (const name of chart.datasets) datasets[name] = report.datasets[name].map((row) => ({ ...row }));
    try {
      await vegaEmbed(element, { ...chart.spec, datasets }, {
        actions: false, renderer: "svg", mode: "vega-lite", config: report.config, tooltip: { disableDefaultStyle: true },
      });
    } catch (error) {
      failed.push(element.dataset.chart);
      console.error(element.dataset.chart, error);
    }
  }
  document.documentElement.dataset.charts = failed.length ? "failed" : "drawn";
})();
