// SPDX-License-Identifier: BSD-3-Clause
// Is docs/gallery.md current? Every effect of the catalogue has its section and picture and no other has; it was drawn
// by the script and specifications of today; a few effects simulated and drawn again give the same text and, within
// three pixels, the same picture.   node gallery.mjs DOCS FRESH EFFECTS.txt
import fs from "node:fs";
import path from "node:path";

const [docs, fresh, effects] = process.argv.slice(2);
const failures = [];
const expect = (holds, what) => { if (!holds) failures.push(what); };
const read = (...parts) => fs.readFileSync(path.join(...parts), "utf8");
const sectionsOf = (text) => Object.fromEntries(text.split(/^## /m).slice(1).map((part) => {
  const [id, ...lines] = part.split("\n");
  // What the fit gains varies in the last digit from machine to machine.
  return [id, lines.filter((line) => !line.startsWith("<!--")).join("\n").replace(/Naming it gains \d+ nats/, "").trim()];
}));

const shipped = read(docs, "gallery.md"), again = read(fresh, "gallery.md");
const stored = sectionsOf(shipped), drawn = sectionsOf(again);
const ids = [...fs.readFileSync(effects, "utf8").matchAll(/^([a-z_0-9]+) {2}\(/gm)].map((m) => m[1]);
expect(ids.length > 40, `only ${ids.length} effects in the catalogue`);
for (const id of ids) {
  expect(id in stored, `${id} has no section`);
  expect(fs.existsSync(path.join(docs, "gallery", `${id}.svg`)), `${id} has no picture`);
}
for (const id of Object.keys(stored)) expect(ids.includes(id), `${id} is in no catalogue`);
const mark = (text) => text.match(/<!-- drawn by \w+ -->/)?.[0];
expect(mark(shipped) === mark(again), "the script, a specification or the colours have changed since");

const number = /-?\d+(\.\d+)?/g;
for (const id of Object.keys(drawn)) {
  expect(stored[id] === drawn[id], `the text of ${id} has changed`);
  const before = read(docs, "gallery", `${id}.svg`), after = read(fresh, "gallery", `${id}.svg`);
  const same = before.replaceAll(number, "#") === after.replaceAll(number, "#");
  const old = before.match(number) ?? [], now = after.match(number) ?? [];
  const off = same ? old.reduce((most, n, i) => Math.max(most, Math.abs(n - now[i])), 0) : Infinity;
  expect(off <= 3, `the picture of ${id} has changed`);
}
for (const failure of failures) console.error(failure);
console.log(failures.length ? "the gallery is not current: make gallery" : `${ids.length} effects, ${Object.keys(drawn).length} drawn again alike`);
process.exitCode = failures.length ? 1 : 0;
