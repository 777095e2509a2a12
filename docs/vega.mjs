// SPDX-License-Identifier: BSD-3-Clause
// What the pictures of docs are drawn with: Vega of the report's node_modules, in the light colours of the report's page.
import fs from "node:fs";
import path from "node:path";
import { createRequire } from "node:module";
import { pathToFileURL } from "node:url";

/// Draws a specification of Vega-Lite: draw(spec, config) is its SVG. `modules`: node_modules, `css`: report/page/page.css.
export async function painter(modules, css) {
  const resolve = createRequire(pathToFileURL(path.join(path.resolve(modules), "index.js"))).resolve;
  const load = async (name) => {
    const own = JSON.parse(fs.readFileSync(path.join(modules, name, "package.json")));
    const entry = typeof own.exports?.["."] === "string" ? own.exports["."] : own.exports?.["."]?.default ?? own.module ?? own.main;
    return import(pathToFileURL(typeof entry === "string" ? path.join(path.resolve(modules), name, entry) : resolve(name)).href);
  };
  const vega = await load("vega");
  const lite = await load("vega-lite");
  const palette = Object.fromEntries([...fs.readFileSync(css, "utf8").split("}")[0].matchAll(/--([a-z]+):\s*(#[0-9a-f]+)/g)].map((m) => [m[1], m[2]]));
  const coloured = (text) => text.replaceAll(/var\(--([a-z]+)\)/g, (_, name) => palette[name]);
  /// Numbers of geometry to a tenth of a pixel; texts stay as they are.
  const rounded = (svg) => svg.replaceAll(/ (d|transform|x|y|x1|x2|y1|y2|width|height)="([^"]*)"/g,
    (_, name, value) => ` ${name}="${value.replaceAll(/(\d+\.\d)\d+/g, "$1")}"`);
  return async (spec, pageConfig) => {
    const config = { ...pageConfig, background: "#ffffff", aria: false, font: "sans-serif" };
    vega.resetSVGDefIds();  // names of clipping paths do not depend on what was drawn before
    const view = new vega.View(vega.parse(lite.compile(spec, { config }).spec), { renderer: "none" });
    const svg = await view.toSVG();
    return rounded(coloured(svg)).replaceAll(/ aria-[a-z]+="[^"]*"| role="[^"]*"| pointer-events="[^"]*"| class="[^"]*"/g, "");
  };
}
