// Charts of the Bokeh library in the colours of the page, with what all of them share.

import { element } from "./text.js";

/** @typedef {{figure: any, view: any, x: (frame: number) => number, frame: (client: number) => number}} Chart */

/** The chart library. @returns {any} */
export const library = () => /** @type {any} */ (globalThis).Bokeh;

/** A colour of the page's style. @param {string} name */
export const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();

/** A new range of an axis. @param {number} start @param {number} end @param {[number, number]} [bounds] */
export const range = (start, end, bounds) => new (library().Range1d)({ start, end, ...(bounds && { bounds }) });

/** A source of columns. @param {Record<string, any>} data */
export const source = (data) => new (library().ColumnDataSource)({ data });

/** Columns by their names, for a glyph. @param {...string} names */
export const fields = (...names) => Object.fromEntries(names.map((name) => [name, { field: name }]));

/**
 * Return a new figure without a toolbar, in the colours of the page; the wheel zooms it with Ctrl, dragging pans it.
 * @param {Record<string, any>} options @param {{axes?: boolean, pan?: boolean}} [parts]
 */
export function figure(options, { axes = true, pan = true } = {}) {
  const B = library();
  const made = new B.Plotting.Figure({ tools: [], toolbar_location: null, sizing_mode: "stretch_width", min_border: 4, ...options });
  const ink = colour("ink"), quiet = colour("line"), paper = colour("paper");
  Object.assign(made, { background_fill_color: paper, border_fill_color: paper, outline_line_color: axes ? quiet : null });
  for (const axis of [...made.xaxes, ...made.yaxes]) {
    const style = {
      visible: axes,
      axis_line_color: quiet, major_tick_line_color: quiet, minor_tick_line_color: null,
      major_label_text_color: ink, axis_label_text_color: ink, major_label_text_font: "system-ui, sans-serif",
      axis_label_text_font: "system-ui, sans-serif", axis_label_text_font_style: "normal", axis_label_text_font_size: "12px",
    };
    Object.assign(axis, style);
  }
  for (const grid of made.center) Object.assign(grid, { visible: axes, grid_line_color: quiet, grid_line_alpha: 0.5 });
  if (pan) {
    const drag = new B.PanTool({ dimensions: "width" });
    const wheel = new B.WheelZoomTool({ dimensions: "width", modifiers: { ctrl: true } });
    made.add_tools(drag, wheel);
    Object.assign(made.toolbar, { active_drag: drag, active_scroll: wheel });
  }
  return made;
}

/** What is drawn in an element. @type {WeakMap<HTMLElement, any>} */
const drawn = new WeakMap();

/** Draw a model of the library into an element, in place of what it held. @param {any} model @param {HTMLElement} place */
export async function put(model, place) {
  const earlier = drawn.get(place);
  if (earlier) {
    const owner = earlier.model.document, { documents } = library(), at = documents.indexOf(owner);
    if (at >= 0) documents.splice(at, 1);
    owner?.views_manager?.clear();
    owner?.clear();
  }
  const host = element("div");
  place.replaceChildren(host);
  const view = await library().Plotting.show(model, host);
  drawn.set(place, view);
  return view;
}

/**
 * Draw a figure into an element, in place of what it held.
 * @param {any} figure @param {HTMLElement} place
 * @returns {Promise<Chart>}
 */
export async function draw(figure, place) {
  const view = await put(figure, place);
  const scale = () => view.frame.x_scale;
  return {
    figure,
    view,
    x: (frame) => scale().compute(frame),
    frame: (client) => Math.round(scale().invert(client - view.el.getBoundingClientRect().left)),
  };
}

/** Call a function once before the next picture, however often it is asked for. @param {() => void} action */
export function soon(action) {
  let is_due = false;
  return () => {
    if (is_due) return;
    is_due = true;
    requestAnimationFrame(() => {
      is_due = false;
      action();
    });
  };
}

/** Call a function when a range changes, at most once a picture. @param {any} axis @param {() => void} action */
export function onRange(axis, action) {
  const later = soon(action);
  axis.properties.start.change.connect(later);
  axis.properties.end.change.connect(later);
}

/** Widen or narrow a range about its middle. @param {any} axis @param {number} factor @param {[number, number]} limits */
export function zoom(axis, factor, limits) {
  const middle = (axis.start + axis.end) / 2, half = (axis.end - axis.start) / 2 * factor;
  axis.setv({ start: Math.max(limits[0], middle - half), end: Math.min(limits[1], middle + half) });
}
