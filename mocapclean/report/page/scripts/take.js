// One take: its numbers, map, player, curves, bones and lists, which all show the same frame.

import { Bones } from "./bones.js";
import { Curves } from "./curves.js";
import { chip, mostUrgent, showLists } from "./lists.js";
import { StatusMap } from "./map.js";
import { bar } from "./overview.js";
import { Player } from "./player.js";
import { Samples } from "./series.js";
import { byId, counted, element, frames, grouped, mm, RULES, shortened } from "./text.js";

const AXES = ["X", "Y", "Z"];
const PAUSE = 100; // ms between two frames that lines and text show while the body moves
const MARGIN = 0.35; // seconds shown on both sides of a gap, and as much as the gap is long

/** The view of one take. */
export class TakeView {
  /** @param {any} page @param {any} summary @param {import("./unpacking.js").Packed} packed */
  constructor(page, summary, packed) {
    this.page = page;
    this.summary = summary;
    this.row = packed.header.row;
    this.samples = packed.header.view ? new Samples(packed, page.statuses) : null;
    this.frame = 0;
    this.marker = 0;
    this.shown = 0;
  }

  /** Show the numbers, then the pictures. @param {() => Promise<void>} load what loads the chart library */
  async draw(load) {
    this.#facts();
    showLists(this.row, (marker, first) => this.go(marker, first));
    byId("pictures").hidden = this.samples === null;
    byId("no-pictures").hidden = this.samples !== null;
    if (!this.samples) return;
    const { samples, page } = this;
    await load();
    this.map = new StatusMap(samples, page.kinds, (marker, frame) => this.open(marker, frame));
    this.player = new Player(samples, page.kinds, (frame) => this.show(frame, true));
    this.curves = new Curves(samples, page.kinds, (frame) => this.read(frame));
    this.bones = new Bones(samples, page.kinds);
    this.#controls();
    await this.map.draw();
    await this.player.draw();
    const first = mostUrgent(this.row.gaps, this.row.findings);
    // At the start of a take a gap is seen best from its end.
    const at = first && (first.first === this.row.first_frame ? first.last : first.first) - this.row.first_frame;
    if (first) await this.open(Math.max(0, samples.markers.indexOf(first.marker)), at);
    else await this.open(0, 0);
  }

  /** Draw the pictures again in another theme. */
  async redraw() {
    if (!this.map || !this.player || !this.curves) return;
    await this.map.draw();
    await this.player.draw();
    await this.curves.redraw();
    if (this.bones) this.bones.chart = null;
    await this.bones?.of(this.marker);
    this.show(this.frame);
  }

  /** The title, the facts, the reasons, the bar and the paragraph. */
  #facts() {
    const { row, summary, page } = this, seconds = summary.rate ? `, ${(row.frames / summary.rate).toFixed(1)} s` : "";
    byId("take-name").textContent = summary.name;
    byId("take-name").title = row.source;
    const method = row.method && row.counts?.filled ? ` · filled by ${row.method}` : "";
    byId("facts").textContent = `${row.format.toUpperCase()} · ${counted(row.markers, "marker")} × ${counted(row.frames, "frame")}` +
      (row.frames ? ` (${row.first_frame}–${row.first_frame + row.frames - 1})` : "") + ` at ${Number(summary.rate.toFixed(3))} Hz${seconds}${method}`;
    byId("level").className = `level level-${summary.level}`;
    byId("level").textContent = page.levels[summary.level];
    byId("reasons").replaceChildren(...summary.reasons.map((/** @type {string} */ text) => element("li", {}, text)));
    byId("take-bar").replaceChildren(bar(summary.shares, summary.samples));
    const figures = [
      ["gaps", grouped(summary.gaps)], ["worst expected error", mm(summary.expected)], ["self-check, 3D", mm(summary.check)],
      ["bones before", mm(summary.bones[0])], ["bones after", mm(summary.bones[1])],
    ];
    byId("figures").replaceChildren(...figures.filter(([, value]) => value !== "–").map(([name, value]) =>
      element("div", {}, element("dt", {}, name), element("dd", {}, value))));
    byId("methods-part").hidden = !summary.methods;
    byId("methods").textContent = summary.methods;
    byId("citation").textContent = page.citation;
    const seen = new Set(Object.entries(summary.shares).filter(([, number]) => number).map(([name]) => name));
    byId("legend").replaceChildren(...page.kinds.filter((/** @type {any} */ kind) => !summary.samples || seen.has(kind.name) || kind.name === "measured")
      .map((/** @type {any} */ kind) => chip(kind.name, kind.name)));
  }

  /** The gaps and suspicions in the order of time, for the keys that go from one to the next. */
  #places() {
    const spans = this.samples?.spans ?? [];
    return [...spans].sort((a, b) => a.start - b.start || a.marker - b.marker);
  }

  /** Go to the next or the last place. @param {number} step */
  step(step) {
    const places = this.#places();
    if (!places.length) return;
    const at = places.findIndex((place) => place.marker === this.marker && place.start <= this.frame && this.frame < place.stop);
    const next = at >= 0 ? at + step : step > 0 ? places.findIndex((place) => place.start >= this.frame) : places.findLastIndex((place) => place.start < this.frame);
    const place = places[(next + places.length) % places.length];
    this.open(place.marker, place.start);
  }

  /** Go to a marker and a frame of the file, by name and number. @param {string | null} marker @param {number | null} first */
  go(marker, first) {
    if (!this.samples) return;
    const column = marker === null ? this.marker : this.samples.markers.indexOf(marker);
    if (column >= 0) this.open(column, first === null ? 0 : first - this.row.first_frame);
    byId("pictures").scrollIntoView({ behavior: "smooth", block: "start" });
  }

  /** Show a marker at a frame: its gap there, its curves, bones and place. @param {number} marker @param {number} frame */
  async open(marker, frame) {
    const samples = /** @type {Samples} */ (this.samples), rate = this.row.rate || this.summary.rate || 100;
    this.marker = marker;
    const span = samples.spans.find((each) => each.marker === marker && each.start <= frame && frame < each.stop);
    const gap = span ? this.#gap(span) : null, first = this.row.first_frame;
    const [start, stop] = gap ? [gap.first - first, gap.last + 1 - first] : span ? [span.start, span.stop] : [frame, frame];
    const margin = Math.max(MARGIN * rate, span ? stop - start : rate);
    if (this.player) this.player.marker = marker;
    this.#describe(span ?? null);
    byId("angles-part").hidden = !samples.channels.length;
    await this.curves?.show_marker(marker, Math.max(0, start - margin), Math.min(samples.n_frames - 1, stop + margin));
    await this.bones?.of(marker);
    this.show(frame);
    document.dispatchEvent(new CustomEvent("opened"));
  }

  /** The gap of the report that a span is in. @param {import("./series.js").Span} span */
  #gap(span) {
    const name = this.samples?.markers[span.marker], at = span.start + this.row.first_frame;
    return this.row.gaps.find((/** @type {any} */ each) => each.marker === name && each.first <= at && at <= each.last) ?? null;
  }

  /** Put the story of a gap into words. @param {import("./series.js").Span | null} span */
  #describe(span) {
    const samples = /** @type {Samples} */ (this.samples), { row } = this, name = samples.markers[this.marker], first = row.first_frame;
    byId("marker-name").textContent = name;
    byId("marker-name").title = name;
    const neighbours = samples.view.neighbours[this.marker].map((/** @type {number} */ other) => shortened(samples.names[other], 20));
    byId("neighbours").textContent = neighbours.length
      ? `Neighbours, shifted into view: ${neighbours.join(", ")} (their distance to it varies least)` : "No neighbours are known.";
    const story = byId("story");
    if (!span) {
      story.replaceChildren(element("p", {}, "Measured here. Click an area of the map, or press n, for a gap."));
      return;
    }
    const at = span.start + first;
    const gap = this.#gap(span);
    const findings = row.findings.filter((/** @type {any} */ finding) => finding.marker === name && finding.first !== null &&
      finding.first <= span.stop - 1 + first && finding.last >= at && finding.rule !== "missing");
    const place = { first: at, last: span.stop - 1 + first };
    const length = place.last - place.first + 1, seconds = (length / (row.rate || this.summary.rate || 1)).toFixed(2);
    const lines = [element("p", {}, chip(span.kind, span.kind), ` ${frames(place)} (${counted(length, "frame")}, ${seconds} s): `,
      samples.statuses[span.code].meaning)];
    if (gap) {
      const whole = gap.first < place.first || gap.last > place.last ? ` Part of the gap of ${frames(gap)}.` : "";
      lines.push(element("p", {}, `Why: ${gap.rules.map((/** @type {string} */ rule) => RULES[rule] ?? rule).join("; ")}.${whole}`));
      const facts = [
        gap.expected_3d !== null && `expected 3D error ${mm(gap.expected_3d)}${gap.grade ? ` (${gap.grade})` : ""}`,
        gap.expected_degrees !== null && `expected rotation error ${gap.expected_degrees.toFixed(1)}°`,
        gap.largest_turn !== null && `turned by up to ${gap.largest_turn.toFixed(1)}°`,
        gap.channels.length && `channels: ${gap.channels.join(", ")}`,
        gap.samples_replaced && `${counted(gap.samples_replaced, "measured sample")} replaced, by up to ${mm(gap.largest_move, 1)}`,
        gap.left_because && `left: ${gap.left_because}`,
        gap.error && `error against the reference ${mm(gap.error.rmse_3d)} in 3D`,
      ].filter(Boolean);
      if (facts.length) lines.push(element("p", {}, `${facts.join("; ")}.`));
    }
    for (const finding of findings.slice(0, 3)) {
      lines.push(element("p", {}, `${finding.suspicion ? "Suspicion" : "Finding"} of ${finding.rule}: ${finding.message}`,
        finding.advice ? element("span", { className: "quiet" }, ` ${finding.advice}`) : ""));
    }
    story.replaceChildren(...lines);
  }

  /** Show a frame everywhere. @param {number} frame @param {boolean} [from_player] */
  show(frame, from_player = false) {
    const samples = /** @type {Samples} */ (this.samples);
    this.frame = Math.max(0, Math.min(samples.n_frames - 1, frame));
    // The pictures of a moving body cost less than the lines, the text and the slider that go with it.
    const now = performance.now();
    if (from_player && now - this.shown < PAUSE) return;
    this.shown = now;
    if (!from_player) this.player?.seek(this.frame);
    this.map?.show(this.frame);
    this.curves?.show(this.frame);
    this.bones?.show(this.frame);
    byId("scrub").value = String(this.frame);
    const rate = this.row.rate || this.summary.rate || 1;
    byId("now").textContent = `frame ${this.frame + this.row.first_frame} · ${(this.frame / rate).toFixed(2)} s`;
    if (!from_player) this.read(this.frame);
  }

  /** Show the exact values of the marker at a frame. @param {number} frame */
  read(frame) {
    const samples = /** @type {Samples} */ (this.samples), { marker } = this;
    if (this.curves?.angles) {
      const rows = this.curves.channels().map((/** @type {any} */ channel) => [`${shortened(channel.joint, 20)} ${channel.axis}`, samples.angle(channel.i, frame, false), samples.angle(channel.i, frame, true),
        channel.unit === "mm" ? " mm" : "°"]);
      this.#reading(frame, rows);
      return;
    }
    const rows = AXES.map((axis, i) => [axis, samples.value(marker, i, frame, false), samples.value(marker, i, frame, true), " mm"]);
    this.#reading(frame, rows, samples.sd ? samples.sd[marker * samples.n_frames + frame] : NaN);
  }

  /** @param {number} frame @param {any[][]} rows @param {number} [sd] */
  #reading(frame, rows, sd = NaN) {
    const samples = /** @type {Samples} */ (this.samples);
    const value = (/** @type {number} */ number, /** @type {string} */ unit) => Number.isNaN(number) ? "missing" : `${number.toFixed(2)}${unit}`;
    const band = Number.isNaN(sd) ? "" : ` · 90 % band ±${(1.645 * sd).toFixed(2)} mm`;
    byId("reading-frame").textContent = `frame ${frame + this.row.first_frame}: ${samples.kind(this.marker, frame)}${band}`;
    byId("reading").replaceChildren(...rows.map(([name, before, after, unit]) => element("tr", {}, element("th", { scope: "row" }, name),
      element("td", {}, value(before, unit)), element("td", {}, value(after, unit)))));
  }

  /** Connect the controls of the pictures. */
  #controls() {
    const samples = /** @type {Samples} */ (this.samples), player = /** @type {Player} */ (this.player), curves = /** @type {Curves} */ (this.curves);
    const map = /** @type {StatusMap} */ (this.map), scrub = byId("scrub");
    Object.assign(scrub, { max: String(samples.n_frames - 1), value: "0", oninput: () => this.show(Number(scrub.value)) });
    byId("play").onclick = () => this.play();
    byId("speed").onchange = () => (player.speed = Number(byId("speed").value));
    player.speed = Number(byId("speed").value);
    for (const name of ["before", "after"]) byId(name).onchange = () => this.compare(name === "after");
    player.is_after = byId("after").checked;
    for (const name of /** @type {("links" | "trails" | "labels")[]} */ (["links", "trails", "labels"])) {
      player.on[name] = byId(name).checked;
      byId(name).onchange = () => ((player.on[name] = byId(name).checked), player.render());
    }
    byId("follow").onchange = () => player.follow(byId("follow").checked);
    byId("follow").checked = player.on.follow;
    byId("look").onchange = () => player.look(byId("look").value);
    byId("up").value = String(player.up);
    byId("up").onchange = () => ((player.up = Number(byId("up").value)), player.render());
    byId("nearer").onclick = () => player.zoom(1 / 1.25);
    byId("farther").onclick = () => player.zoom(1.25);
    byId("map-in").onclick = () => map.zoom(0.5);
    byId("map-out").onclick = () => map.zoom(2);
    byId("map-whole").onclick = () => map.whole();
    byId("all-rows").checked = map.all;
    byId("all-rows").onchange = () => ((map.all = byId("all-rows").checked), map.draw());
    byId("curves-in").onclick = () => curves.zoom(0.5);
    byId("curves-out").onclick = () => curves.zoom(2);
    curves.neighbours = byId("others").checked;
    byId("others").onchange = () => ((curves.neighbours = byId("others").checked), this.redrawCurves());
    curves.angles = byId("angles").checked && samples.channels.length > 0;
    byId("angles").onchange = () => ((curves.angles = byId("angles").checked), this.redrawCurves());
    byId("previous").onclick = () => this.step(-1);
    byId("next").onclick = () => this.step(1);
    byId("copy").onclick = () => navigator.clipboard?.writeText(byId("methods").textContent ?? "");
  }

  async redrawCurves() {
    const curves = /** @type {Curves} */ (this.curves);
    await curves.redraw();
    this.read(this.frame);
    curves.show(this.frame);
  }

  play() {
    const player = /** @type {Player} */ (this.player);
    player.play(!player.is_playing);
    byId("play").textContent = player.is_playing ? "Pause" : "Play";
    byId("play").setAttribute("aria-pressed", String(player.is_playing));
    if (!player.is_playing) this.show(player.frame);
  }

  /** Show the body before or after. @param {boolean} is_after */
  compare(is_after) {
    const player = /** @type {Player} */ (this.player);
    player.is_after = is_after;
    byId(is_after ? "after" : "before").checked = true;
    player.render();
  }

  /** Stop what moves, and free the memory of the samples. */
  close() {
    if (this.player) this.player.is_playing = false;
    byId("play").textContent = "Play";
    byId("play").setAttribute("aria-pressed", "false");
    this.samples?.release();
  }
}
