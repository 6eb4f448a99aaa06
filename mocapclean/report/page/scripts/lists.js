// The gaps, the findings and the markers of a take as tables whose rows lead to their places.

import { byId, counted, element, frames, mm, shortened } from "./text.js";

const STEP = 200; // rows that are added at a time
const NAME = 28; // most characters of a name in a table

/** @typedef {{headers: string[], rows: any[], cells: (row: any) => (string | Node)[], open: (row: any) => void}} Table */

/** Return the tables of a take by the names of their tabs. @param {any} row @param {(marker: string | null, first: number | null) => void} go */
function tables(row, go) {
  const kinds = (/** @type {any} */ gap) => gap.samples_replaced ? "replaced" : gap.samples_filled ? "filled"
    : ["missing", "distrusted"].includes(gap.status) ? gap.status : "left";
  const gaps = [...row.gaps].sort((a, b) => urgency(b) - urgency(a));
  return /** @type {Record<string, Table>} */ ({
    Gaps: {
      headers: ["Marker", "Frames", "Length", "What became of it", "Why", "Expected 3D", "Grade"],
      rows: gaps,
      cells: (gap) => [
        gap.marker, `${gap.first}–${gap.last}`, String(gap.length),
        chip(gap.samples_filled && gap.samples_filled < gap.length ? "left" : kinds(gap), gap.left_because ? `${kinds(gap)}: ${gap.left_because}` : kinds(gap)),
        gap.rules.join(", "), mm(gap.expected_3d), gap.grade ?? "",
      ],
      open: (gap) => go(gap.marker, gap.first),
    },
    Findings: {
      headers: ["Marker", "Frames", "Rule", "Finding", "What to do"],
      rows: row.findings.filter((/** @type {any} */ finding) => finding.rule !== "missing" || !finding.marker),
      cells: (finding) => [
        finding.marker ?? "whole take", frames(finding).replace(/^frames? /, ""),
        finding.suspicion ? chip("suspicious", finding.rule) : finding.rule, finding.message, finding.advice,
      ],
      open: (finding) => go(finding.marker, finding.first),
    },
  });
}

/** How urgent a gap is: larger numbers are to be looked at first. @param {any} gap */
function urgency(gap) {
  const left = gap.length - gap.samples_filled;
  return left * 1e6 + (gap.largest_move ?? 0) * 1e3 + (gap.expected_3d ?? 0);
}

/** The gap that is to be looked at first, or else a suspicion, or else null. @param {any[]} gaps @param {any[]} findings */
export function mostUrgent(gaps, findings) {
  const suspicion = findings.find((finding) => finding.suspicion && finding.marker && finding.first !== null);
  const gap = [...gaps].sort((a, b) => urgency(b) - urgency(a))[0];
  return gap && (urgency(gap) > 1e3 || !suspicion) ? gap : suspicion ?? null;
}

/** A word with the colour and the shape of its kind. @param {string} kind @param {string} text */
export function chip(kind, text) {
  return element("span", { className: `chip ${kind}` }, element("i", { "aria-hidden": "true" }), text);
}

/** Fill the tabs of a take. @param {any} row @param {(marker: string | null, first: number | null) => void} go */
export function showLists(row, go) {
  const all = tables(row, go), tabs = byId("tabs"), place = byId("list");
  const buttons = Object.entries(all).map(([name, table]) =>
    element("button", { type: "button", role: "tab", "aria-selected": "false", "aria-controls": "list", onclick: () => open(name) },
      `${name} (${table.rows.length.toLocaleString("en")})`));
  tabs.replaceChildren(...buttons);
  const open = (/** @type {string} */ name) => {
    Object.keys(all).forEach((each, i) => buttons[i].setAttribute("aria-selected", String(each === name)));
    place.replaceChildren(body(all[name], name));
  };
  open(row.gaps.length ? "Gaps" : "Findings");
}

/** @param {Table} table @param {string} name */
function body(table, name) {
  if (!table.rows.length) return element("p", { className: "quiet" }, `No ${name.toLowerCase()}.`);
  const rows = element("tbody"), more = element("button", { type: "button", className: "more" });
  let shown = 0;
  const add = () => {
    for (const row of table.rows.slice(shown, shown + STEP)) {
      const [first, ...cells] = table.cells(row);
      const button = element("button", { type: "button", className: "link", title: String(first), onclick: () => table.open(row) },
        shortened(String(first), NAME));
      rows.append(element("tr", {}, element("th", { scope: "row" }, button), ...cells.map((cell) => element("td", {}, cell))));
    }
    shown = Math.min(shown + STEP, table.rows.length);
    more.hidden = shown === table.rows.length;
    more.textContent = `Show more of ${counted(table.rows.length, "row")}`;
  };
  more.onclick = add;
  add();
  const head = element("tr", {}, ...table.headers.map((text) => element("th", { scope: "col" }, text)));
  return element("div", {}, element("table", {}, element("caption", { className: "hidden" }, name), element("thead", {}, head), rows), more);
}
