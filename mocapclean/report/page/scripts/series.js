// The samples of a take, before and after, and curves of them at the resolution of the screen.

/** @typedef {{marker: number, start: number, stop: number, kind: string, code: number}} Span */
/** @typedef {import("./unpacking.js").Packed} Packed */

const IN_FILE = 1, IN_OUTPUT = 2;

/** The arrays of one take. */
export class Samples {
  /** @param {Packed} packed @param {{kind: string, code: string, meaning: string}[]} statuses */
  constructor(packed, statuses) {
    const view = packed.header.view;
    this.view = view;
    this.row = packed.header.row;
    /** @type {string[]} */
    this.markers = view.markers;
    const [n_markers, n_frames] = packed.header.arrays.codes.shape;
    // The name of a subject is left out if all markers share it.
    const subject = this.markers[0]?.includes(":") ? this.markers[0].slice(0, this.markers[0].lastIndexOf(":") + 1) : "";
    const is_shared = this.markers.every((marker) => marker.startsWith(subject));
    this.names = this.markers.map((marker) => is_shared ? marker.slice(subject.length) : marker);
    this.n_frames = n_frames;
    this.n_markers = n_markers;
    this.statuses = statuses;
    this.codes = packed.bytes("codes");
    this.rules = packed.bytes("rules");
    this.known = packed.bytes("known");
    this.after = packed.series("after");
    this.before = this.after.slice();
    const changed = packed.numbers("changed"), before = packed.numbers("before");
    changed.forEach((place, i) => {
      const marker = Math.floor(place / n_frames), frame = place % n_frames;
      for (let axis = 0; axis < 3; axis++) this.before[(3 * marker + axis) * n_frames + frame] = before[3 * i + axis];
    });
    /** @type {Float32Array | null} */
    this.sd = packed.header.arrays.sd ? this.#bars(packed.numbers("sd")) : null;
    this.channels = view.channels;
    /** @type {Float32Array | null} */
    this.angles = null;
    /** @type {Float32Array | null} */
    this.angles_before = null;
    /** @type {Uint8Array | null} */
    this.angles_known = null;
    /** @type {Uint8Array | null} */
    this.angles_in_file = null;
    if (this.channels.length) {
      this.angles = packed.series("angles");
      this.angles_before = this.angles.slice();
      const turned = packed.numbers("turned"), values = packed.numbers("turned_before");
      turned.forEach((place, i) => this.angles_before && (this.angles_before[place] = values[i]));
      this.angles_known = packed.bytes("angles_known");
      this.angles_in_file = packed.bytes("angles_in_file");
    }
    this.spans = this.#spans();
  }

  /** Free the memory of the arrays; the take has no frame and no marker then. */
  release() {
    this.n_frames = this.n_markers = 0;
    this.spans = [];
    this.after = this.before = new Float32Array(0);
    this.codes = this.rules = this.known = new Uint8Array(0);
    this.sd = this.angles = this.angles_before = this.angles_known = this.angles_in_file = null;
  }

  /** Return the bars (M, F) of supplied samples, NaN elsewhere. @param {Float64Array} values */
  #bars(values) {
    const bars = new Float32Array(this.codes.length).fill(NaN);
    for (let i = 0, next = 0; i < bars.length; i++) {
      const kind = this.statuses[this.codes[i]].kind;
      if (kind === "filled" || kind === "replaced") {
        const value = values[next++];
        if (value >= 0) bars[i] = value;
      }
    }
    return bars;
  }

  /** Return the runs of samples of one status that are not simply measured. @returns {Span[]} */
  #spans() {
    /** @type {Span[]} */
    const spans = [];
    for (let marker = 0, at = 0; marker < this.n_markers; marker++, at += this.n_frames) {
      for (let frame = 0; frame < this.n_frames;) {
        const code = this.codes[at + frame];
        let stop = frame + 1;
        while (stop < this.n_frames && this.codes[at + stop] === code) stop++;
        const kind = this.statuses[code].kind;
        if (kind !== "measured") spans.push({ marker, start: frame, stop, kind, code });
        frame = stop;
      }
    }
    return spans;
  }

  /** Whether a sample is there, in the file or in the output. @param {number} marker @param {number} frame @param {boolean} after */
  has(marker, frame, after) {
    return (this.known[marker * this.n_frames + frame] & (after ? IN_OUTPUT : IN_FILE)) !== 0;
  }

  /** The kind of a sample. @param {number} marker @param {number} frame */
  kind(marker, frame) {
    return this.statuses[this.codes[marker * this.n_frames + frame]].kind;
  }

  /** A coordinate, mm, NaN where there is none. @param {number} marker @param {number} axis @param {number} frame @param {boolean} after */
  value(marker, axis, frame, after) {
    if (!this.has(marker, frame, after)) return NaN;
    return (after ? this.after : this.before)[(3 * marker + axis) * this.n_frames + frame];
  }

  /** The distance of two markers, mm. @param {number} a @param {number} b @param {number} frame @param {boolean} after */
  distance(a, b, frame, after) {
    let sum = 0;
    for (let axis = 0; axis < 3; axis++) sum += (this.value(a, axis, frame, after) - this.value(b, axis, frame, after)) ** 2;
    return Math.sqrt(sum);
  }

  /** A joint angle, NaN where there is none. @param {number} channel @param {number} frame @param {boolean} after */
  angle(channel, frame, after) {
    const place = channel * this.n_frames + frame;
    const known = after ? this.angles_known : this.angles_in_file, values = after ? this.angles : this.angles_before;
    return known && values && known[place] ? values[place] : NaN;
  }
}

/**
 * Return a curve between two frames with at most about four points for each pixel: the least and the largest value of
 * each stretch, in their order, so that no extreme is lost. A stretch without a value breaks the curve.
 * @param {(frame: number) => number} value
 * @param {number} start @param {number} stop @param {number} pixels
 */
export function decimated(value, start, stop, pixels) {
  /** @type {number[]} */
  const x = [];
  /** @type {number[]} */
  const y = [];
  const width = Math.max(1, Math.floor((stop - start) / Math.max(pixels, 1)));
  for (let from = start; from < stop; from += width) {
    let least = NaN, largest = NaN, at_least = from, at_largest = from, is_broken = false;
    for (let frame = from; frame < Math.min(from + width, stop); frame++) {
      const found = value(frame);
      if (Number.isNaN(found)) {
        is_broken = true;
        continue;
      }
      if (!(found >= least)) [least, at_least] = [found, frame];
      if (!(found <= largest)) [largest, at_largest] = [found, frame];
    }
    const points = at_least <= at_largest ? [[at_least, least], [at_largest, largest]] : [[at_largest, largest], [at_least, least]];
    if (!Number.isNaN(least)) points.slice(at_least === at_largest ? 1 : 0).forEach(([frame, found]) => (x.push(frame), y.push(found)));
    if (is_broken) (x.push(from + width / 2), y.push(NaN));
  }
  return { x, y };
}
