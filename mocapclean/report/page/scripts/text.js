// Elements, and numbers and places in words. Every text enters the page as text, never as markup.

/**
 * Return a new element.
 * @param {string} name @param {Record<string, any>} [properties] @param {...(Node | string | null | undefined | false)} children
 * @returns {any}
 */
export function element(name, properties = {}, ...children) {
  const made = document.createElement(name);
  for (const [key, value] of Object.entries(properties)) {
    if (value === undefined || value === null || value === false) continue;
    if (key in made && key !== "role" && !key.startsWith("aria")) /** @type {any} */ (made)[key] = value;
    else made.setAttribute(key, value === true ? "" : String(value));
  }
  made.append(.../** @type {(Node | string)[]} */ (children.filter((child) => child !== null && child !== undefined && child !== false)));
  return made;
}

/** The element with an id. @param {string} id @returns {any} */
export function byId(id) {
  return document.getElementById(id);
}

/** A number with thousands separators. @param {number} number */
export const grouped = (number) => Math.round(number).toLocaleString("en");

/** A number with its noun. @param {number} number @param {string} word */
export const counted = (number, word) => `${grouped(number)} ${word}${number === 1 ? "" : "s"}`;

/** Millimetres, or a dash. @param {number | null | undefined} value @param {number} [digits] */
export const mm = (value, digits = 2) => value === null || value === undefined || Number.isNaN(value) ? "–" : `${value.toFixed(digits)} mm`;

/** A name of at most some characters. @param {string} name @param {number} most */
export const shortened = (name, most) => name.length > most ? `${name.slice(0, most - 1)}…` : name;

/** The frames of a place in words. @param {{first: number | null, last: number | null}} place */
export const frames = (place) =>
  place.first === null ? "" : place.first === place.last ? `frame ${place.first}` : `frames ${place.first}–${place.last}`;

/** What each rule finds, in words, after "because". @type {Record<string, string>} */
export const RULES = {
  missing: "missing in the file",
  user: "distrusted by the user",
  units: "out of the range of any body",
  swap: "labels exchanged with another marker",
  frozen: "the marker holds its place while its segment moves",
  drift: "the marker moved to another place in its segment",
  flicker: "a burst of noise",
  spike: "a spike: it leaves its path and returns at once",
  jump: "a jump: it leaves its path",
  bone: "the distances to its rigid partners are out of range",
  predict: "far from where the other markers predict it",
  tdd: "faster than a body can move",
  outlier: "the sparse part of a low-rank model",
  pop: "a pop: the joint leaves its path and returns at once",
  hold: "the joint keeps exactly one pose while it should move",
  splice: "a jump of the joint that does not come back",
};
