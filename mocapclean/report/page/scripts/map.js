// The map of a take: a row for each marker, time to the right, an area for each run of samples that is not measured.

import { colour, draw, fields, figure, library, onRange, range, source, zoom } from "./charts.js";
import { byId, element, shortened } from "./text.js";

const ROW = [16, 12]; // pixels of a marker's row, where there are few and where there are many
const MANY = 32; // rows
const WIDE = 6; // pixels from which an area has its pattern

/** The columns of areas. @returns {Record<string, any[]>} */
const NOTHING = () => ({ left: [], right: [], top: [], bottom: [], fill: [] });
const WORD = 8; // most characters of an event's only word
const LABEL = 18; // most characters of a name beside a row

/** @typedef {import("./series.js").Samples} Samples */
/** @typedef {import("./series.js").Span} Span */
/** @typedef {{frame: number, marker: number, select: (marker: number, frame: number) => void, show: (frame: number) => void}} Place */

/** The initials of an event and of whose it is, such as R FS for a right foot strike. @param {{label: string, context: string}} event */
function abbreviated(event) {
  const words = event.label.split(/[ _-]+/).filter(Boolean);
  const label = words.length > 1 ? words.map((word) => word[0].toUpperCase()).join("") : event.label.slice(0, WORD);
  return `${event.context.slice(0, 1)} ${label}`.trim() || "event";
}

/** The map of one take. */
export class StatusMap {
  /**
   * @param {Samples} samples @param {{name: string, colour: string, hatch: string, severity: number}[]} kinds
   * @param {(marker: number, frame: number) => void} select
   */
  constructor(samples, kinds, select) {
    this.samples = samples;
    this.kinds = new Map(kinds.map((kind) => [kind.name, kind]));
    this.select = select;
    const touched = new Set(samples.spans.map((span) => span.marker));
    this.touched = [...touched].sort((a, b) => a - b);
    this.all = samples.n_markers <= 60 || touched.size === 0;
    this.place = /** @type {HTMLElement} */ (byId("map"));
    this.line = element("div", { className: "playhead" });
  }

  /** The markers that have a row, from the top. */
  rows() {
    return this.all ? this.samples.markers.map((_, marker) => marker) : this.touched;
  }

  async draw() {
    const { samples } = this, rows = this.rows(), B = library(), first = samples.row.first_frame;
    this.row_of = new Map(rows.map((marker, row) => [marker, rows.length - 1 - row]));
    this.x = range(first - 0.5, first + samples.n_frames - 0.5, [first - 0.5, first + samples.n_frames - 0.5]);
    const made = figure({
      x_range: this.x, y_range: range(-0.5, rows.length - 0.5), height: Math.max(90, rows.length * ROW[rows.length > MANY ? 1 : 0] + 50),
      x_axis_location: "above", min_border_right: 12,
    });
    const names = rows.map((marker) => shortened(samples.names[marker], LABEL));
    const labels = new Map(rows.map((_, row) => [rows.length - 1 - row, names[row]]));
    Object.assign(made.yaxes[0], {
      ticker: new B.FixedTicker({ ticks: [...labels.keys()] }), major_label_overrides: labels,
      major_label_text_font_size: rows.length > MANY ? "10px" : "11px",
      major_tick_line_color: null,
    });
    made.center.forEach((/** @type {any} */ grid) => grid.dimension === 1 && (grid.visible = false));
    made.hbar({ y: { field: "y" }, left: { field: "left" }, right: { field: "right" }, height: 0.8, fill_color: colour("track"), line_color: null,
      source: source({ y: [...labels.keys()], left: rows.map(() => first - 0.5), right: rows.map(() => first + samples.n_frames - 0.5) }) });
    this.#areas(made);
    this.#events(made, rows.length);
    this.chart = await draw(made, this.place);
    this.place.append(this.line);
    onRange(this.x, () => this.update());
    this.update();
    this.place.onclick = (event) => this.#clicked(event);
    this.place.ondblclick = () => this.whole();
  }

  /** Make the areas: those of a few pixels, and the wider ones of each kind with its pattern, which is costly to make. @param {any} made */
  #areas(made) {
    const ends = fields("left", "right", "top", "bottom");
    this.thin = source(NOTHING());
    made.quad({ ...ends, fill_color: { field: "fill" }, line_color: { field: "fill" }, line_width: 1, source: this.thin });
    this.wide = new Map([...this.kinds.values()].map((kind) => {
      const part = source(NOTHING());
      const pattern = kind.hatch && { hatch_pattern: kind.hatch, hatch_color: colour("paper"), hatch_scale: 7, hatch_alpha: 0.75 };
      made.quad({ ...ends, fill_color: kind.colour, line_color: kind.colour, line_width: 1, ...pattern, source: part });
      return [kind.name, part];
    }));
  }

  /** Draw the file's events as lines with names. @param {any} made @param {number} n_rows */
  #events(made, n_rows) {
    const events = this.samples.view.events, first = this.samples.row.first_frame;
    byId("events").textContent = "";
    if (!events.length) return;
    const x = events.map((/** @type {any} */ event) => event.frame + first);
    // Names that stand close together take turns in two lines.
    const names = events.map((/** @type {any} */ event) => abbreviated(event));
    made.y_range.end = n_rows + 1.6;
    made.height += 26;
    made.segment({ x0: { field: "x" }, x1: { field: "x" }, y0: -0.5, y1: n_rows - 0.4, line_color: colour("ink"), line_alpha: 0.5, line_dash: "3 3",
      source: source({ x }) });
    made.text({ x: { field: "x" }, y: { field: "y" }, text: { field: "text" }, text_font_size: "10px", text_color: colour("ink"), text_align: "center",
      text_font: "system-ui, sans-serif", source: source({ x, y: x.map((/** @type {number} */ _, /** @type {number} */ i) => n_rows - 0.3 + (i % 2) * 0.95), text: names }) });
    const words = new Map(events.map((/** @type {any} */ event) => [abbreviated(event), `${event.context} ${event.label}`.trim()]));
    byId("events").textContent = `Events of the file: ${[...words].map(([short, long]) => `${short} ${shortened(long, 40)}`).join(", ")}`;
  }

  /** Draw the areas of the frames in view; those of less than a pixel are joined, the most severe kind above. */
  update() {
    if (!this.chart || !this.wide) return;
    const first = this.samples.row.first_frame, pixels = Math.max(200, this.place.clientWidth);
    const least = (this.x.end - this.x.start) / pixels;
    const data = new Map([...this.wide.keys(), ""].map((name) => [name, NOTHING()]));
    /** @type {Span | null} */
    let last = null;
    const put = (/** @type {Span} */ span, /** @type {number} */ row) => {
      const part = /** @type {any} */ (data.get(span.stop - span.start > WIDE * least ? span.kind : ""));
      part.left.push(first + span.start - 0.5);
      part.right.push(first + Math.max(span.stop, span.start + least) - 0.5);
      part.top.push(row + 0.4);
      part.bottom.push(row - 0.4);
      part.fill.push(/** @type {any} */ (this.kinds.get(span.kind)).colour);
    };
    for (const span of this.samples.spans) {
      const row = this.row_of?.get(span.marker);
      if (row === undefined || first + span.stop < this.x.start || first + span.start > this.x.end) continue;
      const is_short = span.stop - span.start < least;
      if (last && is_short && last.marker === span.marker && span.start < last.start + least) {
        const [one, other] = [last, span].map((each) => /** @type {any} */ (this.kinds.get(each.kind)).severity);
        if (other <= one) continue;
      }
      put(span, row);
      last = span;
    }
    this.thin.data = data.get("");
    for (const [name, part] of this.wide) if (part.data.left.length || data.get(name)?.left.length) part.data = data.get(name);
    this.show(this.frame ?? 0);
  }

  /** Move the line of the current frame. @param {number} frame */
  show(frame) {
    this.frame = frame;
    if (!this.chart) return;
    const number = frame + this.samples.row.first_frame, x = this.chart.x(number);
    const is_in_view = number >= this.x.start && number <= this.x.end;
    this.line.style.transform = `translateX(${x}px)`;
    this.line.style.visibility = is_in_view ? "visible" : "hidden";
  }

  /** Zoom to frames. @param {number} start @param {number} stop */
  zoomTo(start, stop) {
    const first = this.samples.row.first_frame;
    this.x.setv({ start: Math.max(first - 0.5, first + start), end: Math.min(first + this.samples.n_frames - 0.5, first + stop) });
  }

  whole() {
    this.zoomTo(-0.5, this.samples.n_frames - 0.5);
  }

  /** @param {number} factor */
  zoom(factor) {
    const first = this.samples.row.first_frame;
    zoom(this.x, factor, [first - 0.5, first + this.samples.n_frames - 0.5]);
  }

  /** @param {MouseEvent} event */
  #clicked(event) {
    if (!this.chart) return;
    const box = this.chart.view.el.getBoundingClientRect();
    const row = Math.round(this.chart.view.frame.y_scale.invert(event.clientY - box.top));
    const marker = this.rows()[this.rows().length - 1 - row];
    const frame = this.chart.frame(event.clientX) - this.samples.row.first_frame;
    if (marker === undefined || frame < 0 || frame >= this.samples.n_frames) return;
    // A span of a few pixels is meant by a click near it.
    const reach = 5 * (this.x.end - this.x.start) / this.place.clientWidth;
    const near = this.samples.spans
      .filter((span) => span.marker === marker && frame >= span.start - reach && frame <= span.stop + reach)
      .sort((a, b) => Math.abs(frame - (a.start + a.stop) / 2) - Math.abs(frame - (b.start + b.stop) / 2))[0];
    this.select(marker, near ? Math.min(Math.max(frame, near.start), near.stop - 1) : frame);
  }
}
