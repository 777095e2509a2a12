// SPDX-License-Identifier: BSD-3-Clause
// Opens reports from disk in Chromium and checks what a user relies on: every chart drew marks, hover names the
// reading, nothing is said on the console, nothing is asked of the network, no page is wider than its screen.
//   node browser.mjs CHROMIUM FOLDER REPORT.html...      screenshots go to FOLDER
import { createRequire } from "node:module";
import path from "node:path";
import { pathToFileURL } from "node:url";

const [chromium, folder, ...reports] = process.argv.slice(2);
const modules = process.env.RANGECAL_NODE_MODULES;
const puppeteer = createRequire(pathToFileURL(path.join(modules, "package.json")))("puppeteer-core");

const failures = [];
const expect = (holds, what) => { if (!holds) failures.push(what); };

const screens = [
  { name: "desktop-light", width: 1280, height: 900, scheme: "light" },
  { name: "desktop-dark", width: 1280, height: 900, scheme: "dark" },
  { name: "phone-light", width: 390, height: 844, scheme: "light" },
  { name: "phone-dark", width: 390, height: 844, scheme: "dark" },
];

/// Marks that a chart's SVG holds, by Vega's names of mark groups; guides do not count.
const marksOf = (chart) => [...chart.querySelectorAll("g[class*='mark-']:not([class*='role-axis']):not([class*='role-legend']):not([class*='role-frame']):not([class*='role-scope'])")]
  .filter((group) => !group.closest("[class*='role-axis'], [class*='role-legend'], [class*='role-title']"))
  .reduce((sum, group) => sum + group.querySelectorAll(":scope > path, :scope > text, :scope > line").length, 0);

async function hoverNamesAReading(page, id) {
  const points = await page.evaluate((chart) => {
    const element = document.querySelector(`[data-chart="${chart}"]`);
    element.scrollIntoView({ block: "center" });
    return [...element.querySelectorAll("g.mark-symbol.role-mark path")].filter((p) => p.getBoundingClientRect().width > 0)
      .map((p) => { const box = p.getBoundingClientRect(); return [box.x + box.width / 2, box.y + box.height / 2]; });
  }, id);
  for (const [x, y] of points.slice(0, 400).filter((_, i) => i % 10 === 0)) {
    await page.mouse.move(x - 3, y - 3);
    await page.mouse.move(x, y);
    const text = await page.evaluate(() => document.querySelector("#vg-tooltip-element.visible")?.innerText ?? "");
    if (/stop/.test(text) && /landmark/.test(text) && /file row\s*\d+/.test(text)) return true;
  }
  return false;
}

// How long anything takes is the machine's business: the test's own limit is the only one.
const browser = await puppeteer.launch({
  executablePath: chromium, headless: true, timeout: 0, protocolTimeout: 0,
  args: ["--no-sandbox", "--disable-gpu", "--hide-scrollbars", "--allow-file-access-from-files=false"],
});
try {
  for (const report of reports) {
    const name = path.basename(report, ".html");
    for (const screen of name === "explained" ? screens : [screens[0], screens[3]]) {
      const page = await browser.newPage();
      page.setDefaultTimeout(0);
      const where = `${name}, ${screen.name}`;
      page.on("console", (message) => expect(false, `${where}: console says ${message.type()}: ${message.text()}`));
      page.on("pageerror", (error) => expect(false, `${where}: ${error.message}`));
      page.on("request", (request) => {
        const url = request.url();
        expect(url.startsWith("data:") || url.startsWith("blob:") || url === pathToFileURL(report).href, `${where}: asks for ${url.slice(0, 200)}`);
      });
      await page.setViewport({ width: screen.width, height: screen.height, deviceScaleFactor: 1, hasTouch: screen.width < 600 });
      await page.emulateMediaFeatures([{ name: "prefers-color-scheme", value: screen.scheme }]);
      await page.goto(pathToFileURL(report).href, { timeout: 0 });
      await page.waitForFunction("document.documentElement.dataset.charts !== undefined", { timeout: 0 });
      expect(await page.evaluate("document.documentElement.dataset.charts") === "drawn", `${where}: a chart failed`);
      const charts = await page.evaluate((source) => {
        const marks = eval(source);
        return [...document.querySelectorAll("[data-chart]")].map((c) => ({ id: c.dataset.chart, marks: marks(c) }));
      }, `(${marksOf})`);
      expect(charts.length > 2, `${where}: only ${charts.length} charts`);
      for (const chart of charts) expect(chart.marks > 0, `${where}: chart ${chart.id} drew nothing`);
      const wide = await page.evaluate("document.documentElement.scrollWidth - window.innerWidth");
      expect(wide <= 0, `${where}: ${wide} pixels wider than the screen`);
      if (screen.name === "desktop-light") {
        for (const chart of charts.filter((c) => /^(scene-1|curve|noise|finding-1-before|residual-range-before)$/.test(c.id)))
          expect(await hoverNamesAReading(page, chart.id), `${where}: hover over ${chart.id} names no reading`);
        await page.mouse.move(0, 0);
      }
      await page.evaluate("window.scrollTo(0, 0)");
      await page.screenshot({ path: path.join(folder, `${name}-${screen.name}.png`), fullPage: true });
      await page.close();
    }
  }
} finally {
  await browser.close();
}
for (const failure of failures) console.error(failure);
console.log(failures.length ? `${failures.length} failures` : "every chart drew, hover answers, nothing was asked of the network");
process.exitCode = failures.length ? 1 : 0;
