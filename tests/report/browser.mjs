// SPDX-License-Identifier: BSD-3-Clause
// Opens reports from disk in Chromium and checks what a user relies on: every chart drew marks, hover names the
// reading beside the pointer, nothing is said on the console, nothing is asked of the network, no page is wider than its
// screen, the licences of the charting library are there; no label is cut off and every one can be read, in light, in dark and on paper.
//   node browser.mjs CHROMIUM FOLDER REPORT.html...      screenshots go to FOLDER: of what failed, and of every page (with a
//                                                        PDF of each report) if RANGECAL_SCREENSHOTS is set
import { createRequire } from "node:module";
import path from "node:path";
import { pathToFileURL } from "node:url";

const [chromium, folder, ...reports] = process.argv.slice(2);
const modules = process.env.RANGECAL_NODE_MODULES;
const puppeteer = createRequire(pathToFileURL(path.join(modules, "package.json")))("puppeteer-core");

const pictureAll = Boolean(process.env.RANGECAL_SCREENSHOTS);
const failures = [];
const expect = (holds, what) => { if (!holds) failures.push(what); };

const screens = [
  { name: "desktop-light", width: 1280, height: 900, scheme: "light" },
  { name: "desktop-dark", width: 1280, height: 900, scheme: "dark" },
  { name: "phone-light", width: 390, height: 844, scheme: "light" },
  { name: "phone-dark", width: 390, height: 844, scheme: "dark" },
];

const onePerKind = ["explained", "two-recordings", "methods", "study"];  // of diagnose, calibrate, compare and study

/// Marks that a chart's SVG holds, by Vega's names of mark groups; guides do not count.
const marksOf = (chart) => [...chart.querySelectorAll("g[class*='mark-']:not([class*='role-axis']):not([class*='role-legend']):not([class*='role-frame']):not([class*='role-scope'])")]
  .filter((group) => !group.closest("[class*='role-axis'], [class*='role-legend'], [class*='role-title']"))
  .reduce((sum, group) => sum + group.querySelectorAll(":scope > path, :scope > text, :scope > line").length, 0);

/// Labels of charts that reach beyond their chart, and texts whose contrast with the page is less than `least` to 1. On
/// paper charts are those of the screen, scaled, so that their edges say nothing new.
const unreadable = (least, printed) => {
  const channels = (colour) => (colour.match(/[\d.]+/g) ?? []).slice(0, 3).map(Number);
  const luminance = (colour) => channels(colour).map((c) => c / 255).map((c) => (c <= 0.04045 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4))
    .reduce((sum, c, i) => sum + c * [0.2126, 0.7152, 0.0722][i], 0);
  const paper = luminance(getComputedStyle(document.body).backgroundColor);
  const contrast = (colour) => { const l = luminance(colour); return (Math.max(l, paper) + 0.05) / (Math.min(l, paper) + 0.05); };
  const found = [];
  for (const element of document.querySelectorAll("h1, h2, h3, p, li, td, th, figcaption, footer, .badge")) {
    if (element.closest("#vg-tooltip-element") || !element.innerText.trim()) continue;
    if (contrast(getComputedStyle(element).color) < least) found.push(`pale: ${element.innerText.slice(0, 40)}`);
  }
  for (const chart of document.querySelectorAll("[data-chart]")) {
    const svg = chart.querySelector("svg").getBoundingClientRect();
    for (const text of chart.querySelectorAll("svg text")) {
      const style = getComputedStyle(text), box = text.getBoundingClientRect();
      if (!text.textContent.trim() || style.opacity === "0" || box.width === 0) continue;
      if (contrast(style.fill) < least) found.push(`pale: ${chart.dataset.chart}: ${text.textContent}`);
      if (printed || text.closest("[class*='role-mark']")) continue;  // a mark's own text is clipped with it
      const over = Math.max(svg.left - box.left, box.right - svg.right, svg.top - box.top, box.bottom - svg.bottom);
      if (over > 1.5) found.push(`cut off by ${over.toFixed(1)} pixels: ${chart.dataset.chart}: ${text.textContent}`);
    }
  }
  return found;
};
const leastContrast = 4.5;  // what WCAG asks of text

/// The page as it goes to paper: the width of A4 less its margins, whatever the scheme of the screen.
async function expectPrintable(page, where) {
  await page.emulateMediaType("print");
  await page.setViewport({ width: 703, height: 1000, deviceScaleFactor: 1 });
  expect(await page.evaluate(() => getComputedStyle(document.body).backgroundColor) === "rgb(255, 255, 255)", `${where}: printed on another colour than white`);
  for (const what of await page.evaluate(unreadable, leastContrast, true)) expect(false, `${where}, printed: ${what}`);
  const wide = await page.evaluate(() => document.documentElement.scrollWidth - window.innerWidth);
  expect(wide <= 0, `${where}, printed: ${wide} pixels wider than the paper`);
}

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
    const { text, away } = await page.evaluate((px, py) => {
      const tip = document.querySelector("#vg-tooltip-element.visible");
      if (!tip || getComputedStyle(tip).visibility !== "visible") return { text: "", away: 0 };
      const box = tip.getBoundingClientRect();
      const off = (low, high, at) => Math.max(low - at, 0, at - high);
      const inside = box.left >= 0 && box.top >= 0 && box.right <= innerWidth && box.bottom <= innerHeight;
      return { text: tip.innerText, away: inside ? Math.hypot(off(box.left, box.right, px), off(box.top, box.bottom, py)) : Infinity };
    }, x, y);
    if (/stop/.test(text) && /landmark/.test(text) && /file row\s*\d+/.test(text)) return away < 40;
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
    for (const screen of onePerKind.includes(name) ? screens : [screens[0], screens[3]]) {
      const page = await browser.newPage();
      const failedBefore = failures.length;
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
      const licences = await page.evaluate(() => document.querySelector("footer pre")?.textContent ?? "");
      expect(/^==== vega [\d.]+ \(npm\), BSD-3-Clause ====$/m.test(licences) && licences.includes("University of Washington"), `${where}: no licence of what it contains`);
      const wide = await page.evaluate("document.documentElement.scrollWidth - window.innerWidth");
      expect(wide <= 0, `${where}: ${wide} pixels wider than the screen`);
      if (screen.name === "desktop-light") {
        for (const chart of charts.filter((c) => /^(scene-1|curve|noise|finding-1-before|residual-range-before)$/.test(c.id)))
          expect(await hoverNamesAReading(page, chart.id), `${where}: hover over ${chart.id} names no reading`);
        await page.mouse.move(0, 0);
      }
      await page.evaluate("window.scrollTo(0, 0)");
      for (const what of await page.evaluate(unreadable, leastContrast, false)) expect(false, `${where}: ${what}`);
      if (pictureAll || failures.length > failedBefore)
        await page.screenshot({ path: path.join(folder, `${name}-${screen.name}.png`), fullPage: true });
      if (screen.name === "desktop-dark") {
        await expectPrintable(page, where);
        if (pictureAll) await page.pdf({ path: path.join(folder, `${name}.pdf`), preferCSSPageSize: true, timeout: 0 });
      }
      await page.close();
    }
  }
} finally {
  await browser.close();
}
for (const failure of failures) console.error(failure);
console.log(failures.length ? `${failures.length} failures` : "every chart drew, hover answers, nothing was asked of the network");
process.exitCode = failures.length ? 1 : 0;
