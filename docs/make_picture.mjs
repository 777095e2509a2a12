// SPDX-License-Identifier: BSD-3-Clause
// Draws residuals before and after, side by side, of findings of a report page:
//   rangecal diagnose RECORDING --report PAGE.html
//   node docs/make_picture.mjs PAGE.html build/release/report/web/node_modules report/page/page.css FINDING... > docs/images/diagnosis.svg
// by the page's own specifications, in its light colours, on white; FINDING: their numbers on the page.
import fs from "node:fs";
import { painter } from "./vega.mjs";

const [html, modules, css, ...findings] = process.argv.slice(2);
const draw = await painter(modules, css);

const width = 380, height = 150, head = 22, mostPoints = 300;
const text = fs.readFileSync(html, "utf8").match(/<script type="application\/json" id="report-data">([\s\S]*?)<\/script>/)[1];
const page = JSON.parse(text);

async function drawn(id) {
  const chart = page.charts[id];
  const thinned = (rows) => rows.length <= mostPoints ? rows
    : Array.from({ length: mostPoints }, (_, i) => rows[Math.floor((i + 0.5) * rows.length / mostPoints)]);
  const datasets = Object.fromEntries(chart.datasets.map((name) => [name, name.includes("points") ? thinned(page.datasets[name]) : page.datasets[name]]));
  const spec = { ...chart.spec, width, height, datasets };
  return draw(spec, page.config);
}

const panels = [];
for (const [row, finding] of findings.entries())
  for (const [column, when] of ["before", "after"].entries()) {
    const own = `p${row}${column}`;  // clipping paths of their own
    const svg = (await drawn(`finding-${finding}-${when}`)).replaceAll(/(id="|url\(#)(clip|gradient)/g, `$1${own}$2`);
    panels.push(svg.replace("<svg ", `<svg x="${column * width}" y="${head + row * height}" `));
  }
const heads = ["seed model", "with the causes that were found"].map((text, i) =>
  `<text x="${i * width + 60}" y="15" font-family="sans-serif" font-size="13px" fill="#333333">${text}</text>`);
const size = [2 * width, head + findings.length * height];
process.stdout.write(`<svg xmlns="http://www.w3.org/2000/svg" width="${size[0]}" height="${size[1]}" viewBox="0 0 ${size.join(" ")}">\n`
  + `<rect width="100%" height="100%" fill="#ffffff"/>\n${heads.join("\n")}\n${panels.join("\n")}\n</svg>\n`);
