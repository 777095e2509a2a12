// SPDX-License-Identifier: BSD-3-Clause
// Draws residuals before and after, side by side, of findings of a report page:
//   rangecal diagnose RECORDING --report PAGE.html
//   node docs/make_picture.mjs PAGE.html build/release/report/web/node_modules report/page/page.css FINDING... > docs/images/diagnosis.svg
// by the page's own specifications, in its light colours, on white; FINDING: their numbers on the page.
import fs from "node:fs";
import path from "node:path";
import { createRequire } from "node:module";
import { pathToFileURL } from "node:url";

const [html, modules, css, ...findings] = process.argv.slice(2);
const resolve = createRequire(pathToFileURL(path.join(path.resolve(modules), "index.js"))).resolve;
const load = async (name) => {
  const own = JSON.parse(fs.readFileSync(path.join(modules, name, "package.json")));
  const entry = typeof own.exports?.["."] === "string" ? own.exports["."] : own.exports?.["."]?.default ?? own.module ?? own.main;
  return import(pathToFileURL(typeof entry === "string" ? path.join(path.resolve(modules), name, entry) : resolve(name)).href);
};
const vega = await load("vega");
const lite = await load("vega-lite");

const width = 380, height = 150, head = 22, mostPoints = 300;
const palette = Object.fromEntries([...fs.readFileSync(css, "utf8").split("}")[0].matchAll(/--([a-z]+):\s*(#[0-9a-f]+)/g)].map((m) => [m[1], m[2]]));
const text = fs.readFileSync(html, "utf8").match(/<script type="application\/json" id="report-data">([\s\S]*?)<\/script>/)[1];
const page = JSON.parse(text);

async function drawn(id) {
  const chart = page.charts[id];
  const thinned = (rows) => rows.length <= mostPoints ? rows
    : Array.from({ length: mostPoints }, (_, i) => rows[Math.floor((i + 0.5) * rows.length / mostPoints)]);
  const datasets = Object.fromEntries(chart.datasets.map((name) => [name, name.includes("points") ? thinned(page.datasets[name]) : page.datasets[name]]));
  const spec = { ...chart.spec, width, height, datasets };
  const config = { ...page.config, background: "#ffffff", aria: false, font: "sans-serif" };
  vega.resetSVGDefIds();
  const view = new vega.View(vega.parse(lite.compile(spec, { config }).spec), { renderer: "none" });
  return (await view.toSVG())
    .replaceAll(/var\(--([a-z]+)\)/g, (_, name) => palette[name])
    .replaceAll(/ aria-[a-z]+="[^"]*"| role="[^"]*"| pointer-events="[^"]*"| class="[^"]*"/g, "")
    .replaceAll(/ (d|transform|x|y|x1|x2|y1|y2)="([^"]*)"/g, (_, name, value) => ` ${name}="${value.replaceAll(/(\d+\.\d)\d+/g, "$1")}"`);
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
