// SPDX-License-Identifier: BSD-3-Clause
// Draws docs/gallery.md from what rangecal_gallery wrote, by the report's own specifications:
//   node docs/make_gallery.mjs SPECIMENS NODE_MODULES PAGE.css FOLDER
// FOLDER gets gallery.md and gallery/EFFECT.svg. Pictures are in the report's light colours, on white.
import fs from "node:fs";
import path from "node:path";
import { createHash } from "node:crypto";
import { painter } from "./vega.mjs";

const [specimens, modules, css, folder] = process.argv.slice(2);
const draw = await painter(modules, css);

const mostPoints = 150;
/// One reading of each (stop, landmark), another repeat each time; of more than can be drawn, an even choice.
const thinned = (name, rows) => {
  if (!name.includes("-points") || rows.length <= mostPoints || "moved" in rows[0] || "normal" in rows[0]) return rows;
  const cells = new Map();
  for (const row of rows) {
    const key = JSON.stringify([row.recording, row.stop, row.landmark]);
    cells.set(key, [...(cells.get(key) ?? []), row]);
  }
  const chosen = [...cells.values()].map((cell, i) => cell[i % cell.length]);
  if (chosen.length <= mostPoints) return chosen;
  return Array.from({ length: mostPoints }, (_, i) => chosen[Math.floor((i + 0.5) * chosen.length / mostPoints)]);
};

async function drawn(page, id) {
  const chart = page.charts[id];
  const datasets = Object.fromEntries(chart.datasets.map((name) => [name, thinned(name, page.datasets[name])]));
  const spec = { ...chart.spec, width: 420, height: 200, autosize: { type: "fit", contains: "padding" }, datasets };
  return await draw(spec, page.config) + "\n";
}

/// What the pictures are drawn by: this script and the report's specifications and colours.
const digest = createHash("sha256");
const specs = path.join(path.dirname(css), "..", "specs");
for (const file of [process.argv[1], path.join(path.dirname(process.argv[1]), "vega.mjs"), css, path.join(path.dirname(css), "config.json"),
  ...fs.readdirSync(specs).sort().map((f) => path.join(specs, f))]) digest.update(fs.readFileSync(file));
const inputs = digest.digest("hex").slice(0, 16);

const effects = fs.readdirSync(specimens).filter((f) => f.endsWith(".json")).sort()
  .map((f) => JSON.parse(fs.readFileSync(path.join(specimens, f))));
const channels = [...new Set(effects.map((e) => e.channel))].sort();
const inWords = (effect) => effect.covariate === "any" || effect.covariate === "constant" ? effect.channel : `${effect.channel} along ${effect.covariate}`;
const gain = (effect) => effect.gain >= 3
  ? `Naming it gains ${effect.gain} nats.`
  : "Naming it gains no likelihood: the calibration absorbs it, its traces are counted instead of weighed, or this design cannot fit it.";

/// The first chart; of the moves in x and y the one with the larger.
const chartOf = (page) => {
  const ids = Object.keys(page.charts);
  if (!ids[0]?.endsWith("-x")) return ids[0];
  const moves = Object.values(page.datasets).flat().filter((row) => "moved" in row);
  const largest = moves.reduce((a, b) => (Math.abs(a.moved) > Math.abs(b.moved) ? a : b));
  return ids.find((id) => id.endsWith(`-${largest.axis}`));
};

let text = `# What each effect leaves behind

One recording for every effect of the catalogue, simulated by the physical world with that effect in it and calibrated with the
effect left out. Grey dots are single readings (some of them), coloured ones means of bins with their 95 % bands: what
\`rangecal diagnose\` looks at before it names anything. \`rangecal effects ID\` tells the rest. Made by \`make gallery\`.

| shows in | effects |
|---|---|
`;
for (const channel of channels)
  text += `| ${channel} | ${effects.filter((e) => e.channel === channel).map((e) => `[${e.id}](#${e.id})`).join(", ")} |\n`;
fs.mkdirSync(path.join(folder, "gallery"), { recursive: true });
for (const effect of effects) {
  const id = chartOf(effect.page);
  text += `\n## ${effect.id}\n\n${effect.physics}\n\n    ${effect.formula}\n\n`;
  text += `Shows in: ${inWords(effect)}. Visible by: ${effect.visible_by}. Planted: ${effect.planted}. ${gain(effect)}\n`;
  if (!id) continue;
  fs.writeFileSync(path.join(folder, "gallery", `${effect.id}.svg`), await drawn(effect.page, id));
  text += `\n![Residuals with ${effect.id} left out](gallery/${effect.id}.svg)\n`;
}
text += `\n<!-- drawn by ${inputs} -->\n`;
fs.writeFileSync(path.join(folder, "gallery.md"), text);
