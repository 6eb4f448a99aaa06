// The curves of one marker around a gap: X, Y and Z, or the angles of a joint, before and after, with the 90 % band.

import { colour, fields, figure, library, onRange, put, range, source, zoom } from "./charts.js";
import { decimated } from "./series.js";
import { byId, element, shortened } from "./text.js";

const BAND = 1.645; // standard deviations to both sides that hold 90 % of a normal distribution
const MOST_CHANNELS = 9; // angles that are shown at the same time
const AXES = ["X", "Y", "Z"];
const SHIFT_SAMPLE = 200; // most frames from which the mean distance of a neighbour is taken
const HEIGHT = 128; // pixels of a curve's frame

/** @typedef {import("./series.js").Samples} Samples */
/** @typedef {{label: string, unit: string, before: (frame: number) => number, after: (frame: number) => number,
 *  bar: (frame: number) => number, neighbours: () => ((frame: number) => number)[]}} Curve */

/** The curves of one marker. */
export class Curves {
  /** @param {Samples} samples @param {{name: string, colour: string}[]} kinds @param {(frame: number) => void} hover */
  constructor(samples, kinds, hover) {
    this.samples = samples;
    this.kinds = Object.fromEntries(kinds.map((kind) => [kind.name, kind]));
    this.hover = hover;
    this.marker = 0;
    this.frame = 0;
    this.built = "";
    this.x = range(0, 1);
    this.angles = false;
    this.neighbours = true;
    this.place = /** @type {HTMLElement} */ (byId("curves"));
    this.line = element("div", { className: "playhead" });
    /** @type {any[]} */
    this.charts = [];
  }

  /** The channels of the marker's joint, and those of the joints above it that changed: they decide where it is. */
  channels() {
    const { channels, view, markers } = this.samples, own = markers[this.marker], above = new Set();
    for (let joint = view.parents[own]; joint && !above.has(joint); joint = view.parents[joint]) above.add(joint);
    return channels.map((/** @type {any} */ channel, /** @type {number} */ i) => ({ ...channel, i }))
      .filter((/** @type {any} */ channel) => channel.joint === own || (channel.changed && above.has(channel.joint)))
      .sort((/** @type {any} */ a, /** @type {any} */ b) => Number(b.joint === own) - Number(a.joint === own) || a.i - b.i)
      .slice(0, MOST_CHANNELS);
  }

  /** @returns {Curve[]} */
  curves() {
    const { samples } = this;
    if (this.angles) {
      return this.channels().map((/** @type {any} */ channel) => ({
        label: `${channel.joint === samples.markers[this.marker] ? "" : `${shortened(channel.joint, 10)} `}${channel.axis}`, unit: channel.unit === "mm" ? "mm" : "°", bar: () => NaN, neighbours: () => [],
        before: (/** @type {number} */ frame) => samples.angle(channel.i, frame, false),
        after: (/** @type {number} */ frame) => samples.angle(channel.i, frame, true),
      }));
    }
    return AXES.map((label, axis) => ({
      label, unit: "mm",
      before: (frame) => samples.value(this.marker, axis, frame, false),
      after: (frame) => samples.value(this.marker, axis, frame, true),
      bar: (frame) => samples.sd ? samples.sd[this.marker * samples.n_frames + frame] : NaN,
      neighbours: () => this.neighbours ? samples.view.neighbours[this.marker].map((/** @type {number} */ other) =>
        (/** @type {number} */ frame) => samples.value(other, axis, frame, true)) : [],
    }));
  }

  /** Show a marker between two frames. @param {number} marker @param {number} start @param {number} stop */
  async show_marker(marker, start, stop) {
    const { samples } = this, first = samples.row.first_frame;
    this.marker = marker;
    // The charts of coordinates serve all markers; those of angles are as many as the joint has channels.
    if (this.angles || this.built !== "coordinates") await this.#build(start, stop);
    this.x.setv({ start: first + start, end: first + stop });
    this.update();
  }

  /** Draw all anew when the theme, or what is drawn, has changed. */
  async redraw() {
    const first = this.samples.row.first_frame;
    this.built = "";
    await this.show_marker(this.marker, this.x.start - first, this.x.end - first);
  }

  /** Make the charts. @param {number} start @param {number} stop */
  async #build(start, stop) {
    const B = library(), { samples } = this, first = samples.row.first_frame;
    this.built = this.angles ? "angles" : "coordinates";
    this.x = range(first + start, first + stop, [first - 0.5, first + samples.n_frames - 0.5]);
    const curves = this.curves();
    this.charts = curves.map((curve, number) => this.#chart(curve, number === curves.length - 1));
    const column = new B.Column({ children: this.charts.map((chart) => chart.figure), sizing_mode: "stretch_width", spacing: 2 });
    if (!curves.length) {
      this.place.replaceChildren(element("p", {}, "This joint has no channels of its own."));
      return;
    }
    const view = await put(column, this.place);
    this.place.append(this.line);
    this.views = view.child_views ?? view._child_views ?? [];
    if (this.views.values) this.views = [...this.views.values()];
    onRange(this.x, () => this.update());
    this.place.onmousemove = (event) => {
      const frame = this.at(event.clientX);
      if (frame >= 0 && frame < samples.n_frames) this.hover(frame);
    };
  }

  /** The frame under the pointer. @param {number} client */
  at(client) {
    const view = this.views[0];
    return Math.round(view.frame.x_scale.invert(client - view.el.getBoundingClientRect().left)) - this.samples.row.first_frame;
  }

  /** @param {Curve} curve @param {boolean} is_last */
  #chart(curve, is_last) {
    const y = range(0, 1);
    const made = figure({ x_range: this.x, y_range: y, height: HEIGHT + (is_last ? 38 : 0), y_axis_label: `${curve.label}, ${curve.unit}`,
      min_border_left: 64, min_border_right: 12 });
    made.xaxes[0].visible = is_last;
    if (is_last) made.xaxes[0].axis_label = "frame";
    const parts = {
      others: source({ xs: [], ys: [] }), band: source({ x: [], low: [], high: [] }), before: source({ x: [], y: [] }),
      replaced: source({ x: [], y: [] }), after: source({ x: [], y: [] }), filled: source({ x: [], y: [] }),
    };
    made.multi_line({ ...fields("xs", "ys"), line_color: colour("quiet"), line_alpha: 0.55, line_width: 1, source: parts.others });
    made.varea({ x: { field: "x" }, y1: { field: "low" }, y2: { field: "high" }, fill_color: this.kinds.filled.colour, fill_alpha: 0.22, source: parts.band });
    made.line({ ...fields("x", "y"), line_color: this.kinds.measured.colour, line_width: 3.5, line_alpha: 0.75, source: parts.before });
    made.line({ ...fields("x", "y"), line_color: colour("ink"), line_width: 1.3, source: parts.after });
    made.line({ ...fields("x", "y"), line_color: this.kinds.filled.colour, line_width: 2.4, line_dash: "6 4", source: parts.filled });
    made.scatter({ ...fields("x", "y"), marker: "square", size: 6, fill_color: this.kinds.replaced.colour, line_color: colour("ink"), line_width: 0.5,
      source: parts.replaced });
    return { figure: made, curve, parts, y };
  }

  /** Draw what is in view. */
  update() {
    const { samples, marker } = this, first = samples.row.first_frame;
    const start = Math.max(0, Math.floor(this.x.start - first)), stop = Math.min(samples.n_frames, Math.ceil(this.x.end - first) + 1);
    const pixels = Math.max(200, this.place.clientWidth - 80);
    const kind = (/** @type {number} */ frame) => frame >= 0 && frame < samples.n_frames ? samples.kind(marker, frame) : "measured";
    const supplied = (/** @type {number} */ frame) => kind(frame) === "filled" || kind(frame) === "replaced";
    for (const { curve, parts, y } of this.charts) {
      const shown = (/** @type {(frame: number) => number} */ value) => {
        const found = decimated(value, start, stop, pixels);
        return { x: found.x.map((frame) => frame + first), y: found.y };
      };
      const joined = (/** @type {number} */ frame) => supplied(frame) || supplied(frame - 1) || supplied(frame + 1) ? curve.after(frame) : NaN;
      parts.before.data = shown(curve.before);
      parts.after.data = shown((frame) => supplied(frame) ? NaN : curve.after(frame));
      parts.filled.data = shown(this.angles ? (frame) => curve.after(frame) === curve.before(frame) ? NaN : curve.after(frame) : joined);
      parts.replaced.data = shown((frame) => kind(frame) === "replaced" ? curve.before(frame) : NaN);
      const low = shown((frame) => curve.after(frame) - BAND * curve.bar(frame)), high = shown((frame) => curve.after(frame) + BAND * curve.bar(frame));
      parts.band.data = banded(low, high);
      const values = [...parts.before.data.y, ...parts.after.data.y, ...parts.filled.data.y, ...low.y, ...high.y].filter((v) => !Number.isNaN(v));
      const least = values.reduce((a, b) => Math.min(a, b), Infinity), largest = values.reduce((a, b) => Math.max(a, b), -Infinity);
      const middle = (least + largest) / 2, half = Math.max(0.5, (largest - least) / 2 * 1.12);
      if (values.length) y.setv({ start: middle - half, end: middle + half });
      parts.others.data = this.#others(curve, start, stop, pixels, middle);
    }
    this.show(this.frame);
  }

  /** The neighbours' curves, each shifted by its mean distance from the marker. @param {Curve} curve @param {number} start @param {number} stop @param {number} pixels @param {number} middle */
  #others(curve, start, stop, pixels, middle) {
    const first = this.samples.row.first_frame, step = Math.max(1, Math.floor((stop - start) / SHIFT_SAMPLE));
    const shifted = curve.neighbours().map((value) => {
      let sum = 0, count = 0, own = 0, n_own = 0;
      for (let frame = start; frame < stop; frame += step) {
        const [here, there] = [curve.after(frame), value(frame)];
        if (!Number.isNaN(there)) [own, n_own] = [own + there, n_own + 1];
        if (!Number.isNaN(here - there)) [sum, count] = [sum + here - there, count + 1];
      }
      const shift = count ? sum / count : n_own ? middle - own / n_own : 0;
      const found = decimated(value, start, stop, pixels);
      return { x: found.x.map((frame) => frame + first), y: found.y.map((v) => v + shift) };
    });
    return { xs: shifted.map((one) => one.x), ys: shifted.map((one) => one.y) };
  }

  /** Move the line of the current frame. @param {number} frame */
  show(frame) {
    this.frame = frame;
    const view = this.views?.[0];
    if (!view?.frame || !this.x) return;
    const number = frame + this.samples.row.first_frame;
    this.line.style.visibility = number >= this.x.start && number <= this.x.end ? "visible" : "hidden";
    this.line.style.transform = `translateX(${view.frame.x_scale.compute(number)}px)`;
  }

  /** @param {number} factor */
  zoom(factor) {
    const first = this.samples.row.first_frame;
    if (this.x) zoom(this.x, factor, [first - 0.5, first + this.samples.n_frames - 0.5]);
  }
}

/** Return the area between two curves; where it has no value it is broken. @param {{x: number[], y: number[]}} low @param {{x: number[], y: number[]}} high */
function banded(low, high) {
  const n = Math.min(low.x.length, high.x.length);
  return { x: low.x.slice(0, n), low: low.y.slice(0, n), high: high.y.slice(0, n) };
}
