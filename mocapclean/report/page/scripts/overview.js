// The overview: all takes, sorted by how much they need a person, with search, filters and keys.

import { byId, counted, element, grouped, mm } from "./text.js";

const STEP = 300; // takes that are added at a time

/** The parts of a take's bar in their order, with the name of their style. */
const PARTS = ["left", "missing", "distrusted", "replaced", "suspicious", "poor", "fair", "good", "filled", "moved", "measured", "outside"];

/** @typedef {any} TakeSummary */

/** The order of the takes by each column. @type {Record<string, (take: TakeSummary) => number | string>} */
const ORDERS = {
  attention: (take) => -take.points,
  name: (take) => `${take.folder}/${take.name}`.toLowerCase(),
  left: (take) => -["left", "missing", "distrusted"].reduce((sum, part) => sum + (take.shares[part] ?? 0), 0),
  gaps: (take) => -take.gaps,
  expected: (take) => -(take.expected ?? -1),
  check: (take) => -(take.check ?? -1),
  bones: (take) => -(take.bones[1] ?? -1),
  length: (take) => -take.frames / (take.rate || 1),
};
const COLUMNS = [
  ["attention", "Needs a person"], ["name", "Take"], ["left", "Samples"], ["gaps", "Gaps"], ["expected", "Worst expected error"],
  ["check", "Self-check"], ["bones", "Bones before → after"], ["length", "Length"],
];

/** The table of all takes. */
export class Overview {
  /** @param {{takes: TakeSummary[], levels: string[]}} page @param {(index: number) => void} open */
  constructor(page, open) {
    this.takes = page.takes.map((/** @type {TakeSummary} */ take, /** @type {number} */ index) => ({
      ...take, index, words: `${take.folder}/${take.name} ${take.status} ${take.reasons.join(" ")}`.toLowerCase(),
    }));
    this.levels = page.levels;
    this.open = open;
    this.order = "attention";
    this.level = -1;
    this.body = byId("takes");
    this.rows = new Map();
    this.shown = STEP;
    this.#head();
    byId("search").oninput = () => this.update();
    byId("more-takes").onclick = () => ((this.shown += STEP), this.update(false));
    this.update();
  }

  /** Fill the title, the filters and the column heads. */
  #head() {
    const numbers = this.levels.map((_, level) => this.takes.filter((take) => take.level === level).length);
    byId("headline").textContent = numbers[0] + numbers[1]
      ? `${grouped(numbers[0] + numbers[1])} of ${counted(this.takes.length, "take")} need a look, ${grouped(numbers[0])} of them first`
      : `${counted(this.takes.length, "take")}, none needs a look`;
    const filters = ["all", ...this.levels].map((name, i) => element("button", {
      type: "button", "aria-pressed": String(i === 0), className: i ? `level level-${i - 1}` : "level", "data-level": String(i - 1),
      onclick: () => this.filter(i - 1),
    }, `${name} ${grouped(i ? numbers[i - 1] : this.takes.length)}`));
    byId("filters").replaceChildren(...filters);
    byId("take-head").replaceChildren(element("tr", {}, ...COLUMNS.map(([name, text]) => element("th", { scope: "col", "data-order": name },
      element("button", { type: "button", className: "sort", onclick: () => this.sort(name) }, text)))));
  }

  /** @param {number} level */
  filter(level) {
    this.level = level;
    for (const button of byId("filters").children) button.setAttribute("aria-pressed", String(Number(button.dataset.level) === level));
    this.update();
  }

  /** @param {string} order */
  sort(order) {
    this.order = order;
    this.update();
  }

  /** The takes that match search and filter, in their order. */
  matching() {
    const words = byId("search").value.toLowerCase().split(/\s+/).filter(Boolean), key = ORDERS[this.order];
    return this.takes
      .filter((take) => (this.level < 0 || take.level === this.level) && words.every((/** @type {string} */ word) => take.words.includes(word)))
      .sort((a, b) => (key(a) < key(b) ? -1 : key(a) > key(b) ? 1 : a.index - b.index));
  }

  /** Show the takes that match. @param {boolean} [restart] */
  update(restart = true) {
    if (restart) this.shown = STEP;
    const found = this.matching();
    this.found = found.map((take) => take.index);
    this.body.replaceChildren(...found.slice(0, this.shown).map((take) => this.#row(take)));
    byId("more-takes").hidden = found.length <= this.shown;
    byId("more-takes").textContent = `Show more of ${counted(found.length, "take")}`;
    byId("found").textContent = found.length === this.takes.length ? "" : `${counted(found.length, "take")} found`;
    for (const head of byId("take-head").querySelectorAll("th")) {
      head.setAttribute("aria-sort", head.dataset.order === this.order ? (this.order === "name" ? "ascending" : "descending") : "none");
    }
  }

  /** @param {TakeSummary} take */
  #row(take) {
    const known = this.rows.get(take.index);
    if (known) return known;
    const name = take.key
      ? element("a", { href: `#${take.index + 1}`, className: "take", title: `${take.folder}/${take.name}` }, take.name)
      : element("span", { className: "take", title: `${take.folder}/${take.name}` }, take.name);
    const reasons = element("ul", { className: "reasons" }, ...take.reasons.map((/** @type {string} */ text) => element("li", {}, text)));
    const seconds = take.rate ? `${(take.frames / take.rate).toFixed(1)} s` : "";
    const row = element("tr", {},
      element("td", {}, element("span", { className: `level level-${take.level}` }, this.levels[take.level])),
      element("th", { scope: "row" }, name, element("span", { className: "quiet path" }, take.folder), reasons),
      element("td", {}, bar(take.shares, take.samples)),
      element("td", { className: "number" }, take.gaps ? grouped(take.gaps) : ""),
      element("td", { className: "number" }, take.expected === null ? "" : mm(take.expected, 1)),
      element("td", { className: "number" }, take.check === null || take.check === undefined ? "" : mm(take.check, 1)),
      element("td", { className: "number" }, take.bones[1] === null || take.bones[1] === undefined ? "" : `${take.bones[0].toFixed(1)} → ${mm(take.bones[1], 1)}`),
      element("td", { className: "number" }, seconds, element("span", { className: "quiet" }, `${grouped(take.markers)} × ${grouped(take.frames)}`)));
    row.onclick = (/** @type {MouseEvent} */ event) => {
      if (take.key && !(/** @type {HTMLElement} */ (event.target)).closest("a") && !getSelection()?.toString()) this.open(take.index);
    };
    this.rows.set(take.index, row);
    return row;
  }

  /** Move the focus among the takes. @param {number} step */
  move(step) {
    const links = [...this.body.querySelectorAll("a.take")];
    const at = links.indexOf(document.activeElement);
    links[Math.max(0, Math.min(links.length - 1, at < 0 ? 0 : at + step))]?.focus();
  }
}

/** Return the bar of a take's samples: what is not measured on a scale that shows small parts too, and its numbers.
 * @param {Record<string, number>} shares @param {number} samples */
export function bar(shares, samples) {
  if (!samples) return "";
  const graded = (shares.good ?? 0) + (shares.fair ?? 0) + (shares.poor ?? 0);
  /** @type {Record<string, number>} */
  const parts = { ...shares, filled: Math.max(0, shares.filled - graded) };
  const words = PARTS.filter((part) => parts[part]).map((part) => `${grouped(parts[part])} ${["good", "fair", "poor"].includes(part) ? `filled ${part}` : part}`);
  // The square root of a share keeps one sample in a hundred thousand wider than a hair.
  const width = (/** @type {string} */ part) => Math.sqrt(parts[part] / samples);
  const bits = PARTS.filter((part) => parts[part]).map((part) => element("i", { className: part, style: `flex-grow:${width(part).toFixed(4)}` }));
  const others = words.filter((word) => !word.endsWith(" measured"));
  return element("div", {}, element("div", { className: "bar", role: "img", "aria-label": words.join(", "), title: words.join(", ") }, ...bits),
    element("span", { className: "quiet" }, others.length ? others.join(", ") : "all measured"));
}
