// The length of one bone or rigid pair over time, before and after.

import { colour, draw, fields, figure, onRange, range, source } from "./charts.js";
import { decimated } from "./series.js";
import { byId, element, mm, shortened } from "./text.js";

const NAME = 24; // most characters of a name in the list

/** @typedef {import("./series.js").Samples} Samples */

/** The bones of one take. */
export class Bones {
  /** @param {Samples} samples @param {{name: string, colour: string}[]} kinds */
  constructor(samples, kinds) {
    this.samples = samples;
    this.kinds = Object.fromEntries(kinds.map((kind) => [kind.name, kind]));
    /** @type {[number, number, number][]} */
    this.links = samples.view.links;
    const lengths = new Map(samples.row.bones.lengths.map((/** @type {any} */ bone) => [`${bone.start}\n${bone.end}`, bone]));
    this.reports = this.links.map(([a, b]) => lengths.get(`${samples.markers[a]}\n${samples.markers[b]}`));
    this.order = this.links.map((_, i) => i).sort((a, b) => this.#worst(b) - this.#worst(a));
    this.place = /** @type {HTMLElement} */ (byId("bones"));
    this.list = /** @type {HTMLSelectElement} */ (byId("bone-list"));
    this.list.replaceChildren(...this.order.map((i) => element("option", { value: String(i) }, this.#label(i))));
    this.list.onchange = () => this.draw(Number(this.list.value));
    this.line = element("div", { className: "playhead" });
    this.frame = 0;
    this.bone = this.links[0];
    this.x = range(0, 1);
    this.y = range(0, 1);
    this.parts = { before: source({}), after: source({}), reference: source({}) };
    /** @type {import("./charts.js").Chart | null} */
    this.chart = null;
  }

  /** @param {number} i */
  #worst(i) {
    return Math.max(this.reports[i]?.after.deviation ?? 0, this.reports[i]?.before.deviation ?? 0);
  }

  /** @param {number} i */
  #label(i) {
    const [a, b] = this.links[i], { names } = this.samples, report = this.reports[i];
    const worst = report ? `, off by up to ${mm(report.before.deviation, 1)} before, ${mm(report.after.deviation, 1)} after` : "";
    return `${shortened(names[a], NAME)} – ${shortened(names[b], NAME)}${worst}`;
  }

  /** Show the bone of a marker that deviates most, or else the one that does so of all. @param {number} marker */
  of(marker) {
    return this.draw(this.order.find((i) => this.links[i][0] === marker || this.links[i][1] === marker) ?? this.order[0]);
  }

  /** @param {number} i */
  async draw(i) {
    if (!this.links.length) {
      this.place.replaceChildren(element("p", {}, "No bones are known, and no pair of markers is rigid in this take."));
      return;
    }
    this.list.value = String(i);
    this.bone = this.links[i];
    if (!this.chart) await this.#build();
    this.update();
    this.show(this.frame);
  }

  async #build() {
    const { samples } = this, first = samples.row.first_frame, last = first + samples.n_frames - 1;
    this.x = range(first, last, [first, last]);
    this.y = range(0, 1);
    this.parts = { before: source({ x: [], y: [] }), after: source({ x: [], y: [] }), reference: source({ x0: [], x1: [], y: [] }) };
    const made = figure({ x_range: this.x, y_range: this.y, height: 190, x_axis_label: "frame", y_axis_label: "length, mm", min_border_left: 64,
      min_border_right: 12 });
    made.line({ ...fields("x", "y"), line_color: this.kinds.replaced.colour, line_width: 3, line_alpha: 0.8, source: this.parts.before });
    made.line({ ...fields("x", "y"), line_color: this.kinds.filled.colour, line_width: 1.4, source: this.parts.after });
    made.segment({ ...fields("x0", "x1"), y0: { field: "y" }, y1: { field: "y" }, line_color: colour("ink"), line_dash: "2 4", source: this.parts.reference });
    this.chart = await draw(made, this.place);
    this.place.append(this.line);
    onRange(this.x, () => this.update());
  }

  /** Draw what is in view. */
  update() {
    const { samples } = this, first = samples.row.first_frame, [a, b, reference] = this.bone;
    const start = Math.max(0, Math.floor(this.x.start - first)), stop = Math.min(samples.n_frames, Math.ceil(this.x.end - first) + 1);
    let [least, largest] = [reference, reference];
    for (const [part, is_after] of /** @type {[any, boolean][]} */ ([[this.parts.before, false], [this.parts.after, true]])) {
      const found = decimated((frame) => samples.distance(a, b, frame, is_after), start, stop, this.place.clientWidth - 80);
      part.data = { x: found.x.map((frame) => frame + first), y: found.y };
      for (const value of found.y) if (!Number.isNaN(value)) [least, largest] = [Math.min(least, value), Math.max(largest, value)];
    }
    this.parts.reference.data = { x0: [first], x1: [first + samples.n_frames], y: [reference] };
    const half = Math.max(1, (largest - least) / 2 * 1.1);
    this.y.setv({ start: (least + largest) / 2 - half, end: (least + largest) / 2 + half });
  }

  /** Move the line of the current frame. @param {number} frame */
  show(frame) {
    this.frame = frame;
    if (!this.chart) return;
    const number = frame + this.samples.row.first_frame;
    this.line.style.visibility = number >= this.x.start && number <= this.x.end ? "visible" : "hidden";
    this.line.style.transform = `translateX(${this.chart.x(number)}px)`;
  }
}
