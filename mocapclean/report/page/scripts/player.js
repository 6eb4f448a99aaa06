// The moving body: markers and links of one frame, seen from a camera that turns about them.

import { colour, draw, fields, figure, range, source } from "./charts.js";
import { byId, shortened } from "./text.js";

const HEIGHT = 560; // pixels
const TRAIL = 0.5; // seconds of path behind and ahead of a marker
const MOST_TRAILS = 24; // markers with a path at the same time
const LABEL = 20; // most characters of a name beside a marker
const FLOOR_STEP = 500; // mm between the lines of the floor
const MEASURED = 150; // most frames from which the size of the motion is taken
const MARGIN = 0.66; // half of the picture over the size of what is in it
const PURSUIT = 0.2; // part of the way to the middle of the body that the camera goes in a picture
const FAR = 1.4; // how many times its own size a body may move without being followed
const SIGHT = 3; // distance of the eye in half widths of the picture: a mild perspective
const VIEWS = /** @type {Record<string, [number, number]>} */ ({ front: [0, 0.12], side: [Math.PI / 2, 0.12], top: [0, Math.PI / 2], corner: [0.7, 0.3] });

/** @typedef {import("./series.js").Samples} Samples */

/** The player of one take. */
export class Player {
  /** @param {Samples} samples @param {{name: string, colour: string, shape: string}[]} kinds @param {(frame: number) => void} show */
  constructor(samples, kinds, show) {
    this.samples = samples;
    this.kinds = new Map(kinds.map((kind) => [kind.name, kind]));
    this.show_frame = show;
    this.frame = 0;
    this.marker = -1;
    this.is_after = true;
    this.is_playing = false;
    this.speed = 1;
    this.drawn = 0;
    this.on = { links: true, trails: true, labels: true, follow: false };
    this.yaw = VIEWS.corner[0];
    this.pitch = VIEWS.corner[1];
    this.turned = { cos_yaw: 1, sin_yaw: 0, cos_pitch: 1, sin_pitch: 0 };
    this.axes = [0, 1, 2];
    this.up = samples.view.up;
    this.place = /** @type {HTMLElement} */ (byId("player"));
    this.extent = measured(samples);
    // A body that walks far is small in a picture of its whole way.
    this.on.follow = this.extent.whole > FAR * this.extent.body;
    this.size = this.on.follow ? this.extent.body : this.extent.whole;
    this.target = [...this.extent.middle];
    this.seen = "";
    /** @type {import("./charts.js").Chart | null} */
    this.chart = null;
    this.sources = this.#new();
  }

  /** New sources of what is drawn. */
  #new() {
    return {
      floor: source({ x0: [], y0: [], x1: [], y1: [] }),
      links: source({ x0: [], y0: [], x1: [], y1: [], alpha: [] }),
      trails: source({ xs: [], ys: [], color: [] }),
      points: source({ x: [], y: [], size: [], color: [], shape: [], alpha: [], edge: [] }),
      names: source({ x: [], y: [], text: [] }),
    };
  }

  async draw() {
    const made = figure({ height: HEIGHT, x_range: range(-1, 1), y_range: range(-1, 1), min_border: 0 }, { axes: false, pan: false });
    this.seen = "";
    this.sources = this.#new();
    const ends = fields("x0", "y0", "x1", "y1");
    made.segment({ ...ends, line_color: colour("line"), line_width: 1, source: this.sources.floor });
    made.segment({ ...ends, line_color: colour("quiet"), line_width: 2, line_alpha: { field: "alpha" }, source: this.sources.links });
    made.multi_line({ ...fields("xs", "ys"), line_color: { field: "color" }, line_width: 1.5, line_alpha: 0.7, source: this.sources.trails });
    made.scatter({ ...fields("x", "y", "size"), fill_color: { field: "color" }, line_color: { field: "edge" }, marker: { field: "shape" },
      fill_alpha: { field: "alpha" }, line_width: 1.2, source: this.sources.points });
    made.text({ ...fields("x", "y", "text"), x_offset: 8, y_offset: -6, text_color: colour("ink"), text_font_size: "11px",
      text_font: "system-ui, sans-serif", source: this.sources.names });
    this.chart = await draw(made, this.place);
    this.#gestures();
    this.render();
  }

  /** Turn with the pointer, zoom with the wheel and Ctrl, or with two keys. */
  #gestures() {
    const { place } = this;
    place.onpointerdown = (event) => {
      place.setPointerCapture(event.pointerId);
      let [x, y] = [event.clientX, event.clientY];
      place.onpointermove = (moved) => {
        this.yaw -= (moved.clientX - x) * 0.01;
        this.pitch = Math.min(Math.PI / 2, Math.max(-Math.PI / 2, this.pitch + (moved.clientY - y) * 0.01));
        [x, y] = [moved.clientX, moved.clientY];
        this.render();
      };
      place.onpointerup = place.onpointercancel = () => (place.onpointermove = null);
    };
    place.onwheel = (event) => {
      if (!event.ctrlKey && !event.shiftKey) return;
      event.preventDefault();
      this.zoom(event.deltaY > 0 ? 1.1 : 1 / 1.1);
    };
  }

  /** @param {number} factor */
  zoom(factor) {
    this.size = Math.min(1e6, Math.max(20, this.size * factor));
    this.render();
  }

  /** See from a named direction. @param {string} name */
  look(name) {
    this.yaw = VIEWS[name][0];
    this.pitch = VIEWS[name][1];
    this.render();
  }

  /** Follow the body, or see the whole way. @param {boolean} on */
  follow(on) {
    this.on.follow = on;
    this.size = on ? this.extent.body : this.extent.whole;
    this.render();
  }

  /** Aim at the middle of the markers, or at the middle of the whole way. */
  #aim() {
    if (!this.on.follow) {
      this.target = this.extent.middle;
      return;
    }
    const least = [Infinity, Infinity, Infinity], largest = [-Infinity, -Infinity, -Infinity];
    for (let marker = 0; marker < this.samples.n_markers; marker++) {
      if (!this.samples.has(marker, this.frame, true)) continue;
      for (let axis = 0; axis < 3; axis++) {
        const value = this.samples.value(marker, axis, this.frame, true);
        least[axis] = Math.min(least[axis], value);
        largest[axis] = Math.max(largest[axis], value);
      }
    }
    // A smooth pursuit, so that one marker that appears does not shake the picture.
    const middle = least.map((value, axis) => (value + largest[axis]) / 2), pursuit = this.is_playing ? PURSUIT : 1;
    if (Number.isFinite(middle[0])) this.target = middle.map((value, axis) => this.target[axis] + pursuit * (value - this.target[axis]));
  }

  /** Return where a point is in the picture, and its scale. @param {number} x @param {number} y @param {number} z */
  project(x, y, z) {
    const [right, forward, up] = this.axes, { cos_yaw, sin_yaw, cos_pitch, sin_pitch } = this.turned;
    const point = [x - this.target[0], y - this.target[1], z - this.target[2]];
    // Turn about the vertical, then tilt: the picture's axes are to the right, up, and away from the eye.
    const a = point[right] * cos_yaw - point[forward] * sin_yaw;
    const depth = point[right] * sin_yaw + point[forward] * cos_yaw;
    const b = point[up] * cos_pitch + depth * sin_pitch;
    const away = depth * cos_pitch - point[up] * sin_pitch;
    const scale = 1 / (this.size * Math.max(0.2, 1 + away / (SIGHT * this.size)));
    return [a * scale, b * scale, scale * this.size];
  }

  /** Draw the current frame. */
  render() {
    if (!this.chart) return;
    const { frame } = this;
    this.drawn++;
    this.#aim();
    // Axes to the right of and away from an eye that looks along the second one; the third is up.
    this.axes = this.up === 2 ? [0, 1, 2] : this.up === 1 ? [2, 0, 1] : [1, 2, 0];
    this.turned = { cos_yaw: Math.cos(this.yaw), sin_yaw: Math.sin(this.yaw), cos_pitch: Math.cos(this.pitch), sin_pitch: Math.sin(this.pitch) };
    const width = this.chart.view.frame_view?.bbox?.width ?? 600, height = this.chart.view.frame_view?.bbox?.height ?? HEIGHT;
    const aspect = width / height;
    if (Math.abs(this.chart.figure.x_range.end - aspect) > 1e-3) this.chart.figure.x_range.setv({ start: -aspect, end: aspect });
    const places = this.#places(frame);
    this.#points(places);
    this.#links(places);
    if (this.on.trails || this.sources.trails.data.xs.length) this.#trails();
    this.#floor();
  }

  /** @param {number} frame */
  #places(frame) {
    const { samples, is_after } = this, places = new Array(samples.n_markers);
    for (let marker = 0; marker < samples.n_markers; marker++) {
      const x = samples.value(marker, 0, frame, is_after);
      places[marker] = Number.isNaN(x) ? null
        : this.project(x, samples.value(marker, 1, frame, is_after), samples.value(marker, 2, frame, is_after));
    }
    return places;
  }

  /** @param {([number, number, number] | null)[]} places */
  #points(places) {
    const { samples, frame } = this, ink = colour_of("ink"), paper = colour_of("paper");
    const order = places.map((_, marker) => marker).filter((marker) => places[marker]);
    order.sort((a, b) => /** @type {any} */ (places[a])[2] - /** @type {any} */ (places[b])[2]);
    /** @type {Record<string, any[]>} */
    const data = { x: [], y: [], size: [], color: [], shape: [], alpha: [], edge: [] };
    /** @type {{x: number[], y: number[], text: string[]}} */
    const names = { x: [], y: [], text: [] };
    for (const marker of order) {
      const [x, y, scale] = /** @type {[number, number, number]} */ (places[marker]);
      const kind = /** @type {any} */ (this.kinds.get(samples.kind(marker, frame)));
      const is_plain = kind.name === "measured", is_chosen = marker === this.marker;
      data.x.push(x);
      data.y.push(y);
      data.size.push((is_plain ? 6 : 11) * Math.min(1.6, Math.max(0.6, scale)) + (is_chosen ? 5 : 0));
      data.color.push(kind.colour);
      data.shape.push(kind.shape);
      data.alpha.push(Math.min(1, Math.max(0.35, scale)));
      data.edge.push(is_chosen || kind.shape === "x" ? (is_chosen ? ink : kind.colour) : paper);
      if (this.on.labels && (!is_plain || is_chosen)) {
        names.x.push(x);
        names.y.push(y);
        names.text.push(shortened(samples.names[marker], LABEL) + (is_plain ? "" : ` · ${kind.name}`));
      }
    }
    this.sources.points.data = data;
    this.sources.names.data = names;
  }

  /** @param {([number, number, number] | null)[]} places */
  #links(places) {
    /** @type {Record<string, number[]>} */
    const data = { x0: [], y0: [], x1: [], y1: [], alpha: [] };
    if (this.on.links) {
      for (const [a, b] of this.samples.view.links) {
        const from = places[a], to = places[b];
        if (!from || !to) continue;
        data.x0.push(from[0]);
        data.y0.push(from[1]);
        data.x1.push(to[0]);
        data.y1.push(to[1]);
        data.alpha.push(Math.min(0.9, Math.max(0.25, (from[2] + to[2]) / 2 - 0.25)));
      }
    }
    this.sources.links.data = data;
  }

  /** The paths of the chosen marker and of those that are not measured now. */
  #trails() {
    const { samples, frame, is_after } = this;
    /** @type {Record<string, any[]>} */
    const data = { xs: [], ys: [], color: [] };
    if (this.on.trails) {
      const reach = Math.max(2, Math.round(TRAIL * samples.row.rate)), step = Math.max(1, Math.floor(reach / 24));
      for (let marker = 0; marker < samples.n_markers && data.xs.length < MOST_TRAILS; marker++) {
        const kind = samples.kind(marker, frame);
        if (marker !== this.marker && kind === "measured") continue;
        const xs = [], ys = [];
        for (let at = Math.max(0, frame - reach); at <= Math.min(samples.n_frames - 1, frame + reach); at += step) {
          const x = samples.value(marker, 0, at, is_after);
          const place = Number.isNaN(x) ? [NaN, NaN] : this.project(x, samples.value(marker, 1, at, is_after), samples.value(marker, 2, at, is_after));
          xs.push(place[0]);
          ys.push(place[1]);
        }
        data.xs.push(xs);
        data.ys.push(ys);
        data.color.push(/** @type {any} */ (this.kinds.get(kind)).colour);
      }
    }
    this.sources.trails.data = data;
  }

  /** The lines of the floor, drawn anew when the camera has moved. */
  #floor() {
    const seen = [this.yaw, this.pitch, this.size, this.up, ...this.target].join();
    if (seen === this.seen) return;
    this.seen = seen;
    const [right, forward] = this.axes, level = this.extent.low[this.up];
    /** @type {Record<string, number[]>} */
    const data = { x0: [], y0: [], x1: [], y1: [] };
    const step = FLOOR_STEP * Math.max(1, Math.round(this.extent.whole / 4000));
    const bounds = [right, forward].map((axis) => [Math.floor(this.extent.from[axis] / step - 1) * step, Math.ceil(this.extent.to[axis] / step + 1) * step]);
    const add = (/** @type {number} */ from_right, /** @type {number} */ from_forward, /** @type {number} */ to_right, /** @type {number} */ to_forward) => {
      const from = [0, 0, 0], to = [0, 0, 0];
      [from[right], from[forward], from[this.up], to[right], to[forward], to[this.up]] = [from_right, from_forward, level, to_right, to_forward, level];
      const a = this.project(from[0], from[1], from[2]), b = this.project(to[0], to[1], to[2]);
      data.x0.push(a[0]);
      data.y0.push(a[1]);
      data.x1.push(b[0]);
      data.y1.push(b[1]);
    };
    for (let at = bounds[0][0]; at <= bounds[0][1]; at += step) add(at, bounds[1][0], at, bounds[1][1]);
    for (let at = bounds[1][0]; at <= bounds[1][1]; at += step) add(bounds[0][0], at, bounds[0][1], at);
    this.sources.floor.data = data;
  }

  /** Show a frame. @param {number} frame */
  seek(frame) {
    this.frame = Math.max(0, Math.min(this.samples.n_frames - 1, frame));
    this.render();
  }

  /** Play in real time times the speed, or stop. @param {boolean} on */
  play(on) {
    if (on === this.is_playing) return;
    this.is_playing = on;
    if (!on) return;
    if (this.frame >= this.samples.n_frames - 1) this.frame = 0;
    let last = performance.now(), exact = this.frame;
    const step = (/** @type {number} */ now) => {
      if (!this.is_playing) return;
      if (Math.round(exact) !== this.frame) exact = this.frame;
      exact += (now - last) / 1000 * this.samples.row.rate * this.speed;
      last = now;
      if (exact >= this.samples.n_frames - 1) exact = 0;
      const frame = Math.min(this.samples.n_frames - 1, Math.round(exact));
      if (frame !== this.frame) {
        this.frame = frame;
        exact = Math.abs(exact - frame) < 1 ? exact : frame;
        this.render();
        this.show_frame(frame);
      }
      requestAnimationFrame(step);
    };
    requestAnimationFrame(step);
  }
}

/** Return the middle and the half size of the motion and of a body, mm, and where the motion and the floor are.
 * @param {Samples} samples */
function measured(samples) {
  const step = Math.max(1, Math.floor(samples.n_frames / MEASURED));
  /** @type {number[][]} */
  const found = [[], [], []];
  /** @type {number[]} */
  const bodies = [];
  for (let frame = 0; frame < samples.n_frames; frame += step) {
    const least = [Infinity, Infinity, Infinity], largest = [-Infinity, -Infinity, -Infinity];
    for (let marker = 0; marker < samples.n_markers; marker++) {
      if (!samples.has(marker, frame, true)) continue;
      for (let axis = 0; axis < 3; axis++) {
        const value = samples.value(marker, axis, frame, true);
        found[axis].push(value);
        least[axis] = Math.min(least[axis], value);
        largest[axis] = Math.max(largest[axis], value);
      }
    }
    const body = Math.max(...least.map((value, axis) => largest[axis] - value));
    if (Number.isFinite(body)) bodies.push(body);
  }
  for (const values of [...found, bodies]) values.sort((a, b) => a - b);
  const part = (/** @type {number[]} */ values, /** @type {number} */ share) => values[Math.floor(share * (values.length - 1))] ?? 0;
  // Single samples that are far off would make the rest small.
  const from = found.map((values) => part(values, 0.02)), to = found.map((values) => part(values, 0.98));
  return {
    middle: from.map((value, axis) => (value + to[axis]) / 2), from, to, low: found.map((values) => part(values, 0.002)),
    whole: MARGIN * Math.max(100, ...from.map((value, axis) => to[axis] - value)), body: MARGIN * (part(bodies, 0.5) || 1000),
  };
}

/** @type {Map<string, string>} */
const colours = new Map();

/** A colour of the style, read once for each theme. @param {string} name */
function colour_of(name) {
  const key = `${document.documentElement.dataset.theme}${name}`;
  if (!colours.has(key)) colours.set(key, colour(name));
  return /** @type {string} */ (colours.get(key));
}
