// The page: which of its takes is shown, the theme, and the keys.

import { colour } from "./charts.js";
import { Overview } from "./overview.js";
import { TakeView } from "./take.js";
import { byId, element } from "./text.js";
import { unpack } from "./unpacking.js";

/** @type {any} */
const global = globalThis;
const THEMES = ["auto", "light", "dark"];

/** Load a script beside the page, once. @param {string} name @returns {Promise<void>} */
function loaded(name) {
  return new Promise((done, failed) => {
    const script = element("script", { src: `${document.body.dataset.folder}/${name}`, onload: () => done(), onerror: () => failed(new Error(`${name} is not beside the page`)) });
    document.head.append(script);
  });
}

async function loadLibrary() {
  for (const name of (document.body.dataset.files ?? "").split(" ").filter(Boolean)) {
    if (!global.mocapcleanTakes[name]) await loaded(name);
    global.mocapcleanTakes[name] = "loaded";
  }
  if (global.Bokeh) global.Bokeh.set_log_level("error");
}

/** Set the theme: that of the system, light or dark; kinds of samples have their colours in it. @param {string} theme @param {any[]} kinds */
function setTheme(theme, kinds) {
  const dark = theme === "dark" || (theme === "auto" && matchMedia("(prefers-color-scheme: dark)").matches);
  document.documentElement.dataset.theme = dark ? "dark" : "light";
  byId("theme").textContent = `Theme: ${theme}`;
  byId("theme").dataset.theme = theme;
  for (const kind of kinds) kind.colour = colour(kind.name);
}

async function start() {
  const page = (await unpack(byId("overview-data").textContent.trim())).header;
  /** @type {TakeView | null} */
  let view = null;
  let shown = NaN;
  const is_single = page.takes.length === 1 && page.takes[0].key;
  const overview = new Overview(page, (index) => (location.hash = `#${index + 1}`));
  global.mocapclean = { overview, view: () => view, page };
  setTheme("auto", page.kinds);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
    setTheme(byId("theme").dataset.theme, page.kinds);
    view?.redraw();
  });
  byId("theme").onclick = () => {
    setTheme(THEMES[(THEMES.indexOf(byId("theme").dataset.theme) + 1) % THEMES.length], page.kinds);
    view?.redraw();
  };
  byId("help-button").onclick = () => byId("help").showModal();

  /** Show a take, or the overview for -1. @param {number} index */
  async function show(index) {
    if (index === shown) return;
    shown = index;
    view?.close();
    view = null;
    document.body.dataset.show = index < 0 ? "overview" : "take";
    byId("take").setAttribute("aria-busy", String(index >= 0));
    if (index < 0) {
      document.title = byId("headline").textContent;
      overview.body.querySelector(`a[href="#${show.last + 1}"]`)?.focus();
      return;
    }
    show.last = index;
    const take = page.takes[index];
    document.title = take.name;
    byId("problem").textContent = "";
    try {
      if (!global.mocapcleanTakes[take.key]) await loaded(`${take.key}.js`);
      const opened = new TakeView(page, take, await unpack(global.mocapcleanTakes[take.key]));
      if (document.body.dataset.folder) delete global.mocapcleanTakes[take.key];
      if (shown !== index) return;
      view = opened;
      await opened.draw(loadLibrary);
      byId("take").setAttribute("aria-busy", "false");
      document.body.dataset.ready = take.key;
      document.dispatchEvent(new CustomEvent("shown"));
    } catch (problem) {
      byId("problem").textContent = `This take cannot be shown: ${/** @type {Error} */ (problem).message}.`;
      throw problem;
    }
  }
  show.last = -1;

  const follow = () => {
    const number = Number.parseInt(location.hash.slice(1), 10);
    const index = number >= 1 && number <= page.takes.length && page.takes[number - 1].key ? number - 1 : is_single ? 0 : -1;
    return show(index);
  };
  addEventListener("hashchange", follow);
  byId("back").hidden = Boolean(is_single);
  byId("back").onclick = () => (location.hash = "");
  const sibling = (/** @type {number} */ step) => {
    const known = (overview.found ?? []).filter((index) => page.takes[index].key), at = known.indexOf(shown);
    if (at >= 0 && known[at + step] !== undefined) location.hash = `#${known[at + step] + 1}`;
  };
  byId("previous-take").onclick = () => sibling(-1);
  byId("next-take").onclick = () => sibling(1);
  for (const name of ["previous-take", "next-take"]) byId(name).hidden = Boolean(is_single);

  addEventListener("keydown", (event) => {
    const target = /** @type {HTMLElement} */ (event.target);
    if (event.ctrlKey || event.metaKey || event.altKey || byId("help").open) return;
    if (target.matches("input:not([type=range]):not([type=checkbox]):not([type=radio]), select")) {
      if (event.key === "Escape") target.blur();
      return;
    }
    const on_control = target.matches("button, a, input, summary");
    /** @type {Record<string, () => void>} */
    const keys = view
      ? {
        " ": () => view?.play(), ArrowLeft: () => view?.show(view.frame - (event.shiftKey ? 10 : 1)),
        ArrowRight: () => view?.show(view.frame + (event.shiftKey ? 10 : 1)), Home: () => view?.show(0),
        End: () => view?.show(Infinity), n: () => view?.step(1), p: () => view?.step(-1),
        b: () => view?.compare(!view.player?.is_after), "+": () => view?.map?.zoom(0.5), "-": () => view?.map?.zoom(2),
        0: () => view?.map?.whole(), j: () => sibling(1), k: () => sibling(-1), Escape: () => !is_single && (location.hash = ""),
        "?": () => byId("help").showModal(),
      }
      : {
        "/": () => byId("search").focus(), ArrowDown: () => overview.move(1), ArrowUp: () => overview.move(-1), j: () => overview.move(1),
        k: () => overview.move(-1), "?": () => byId("help").showModal(),
      };
    if (on_control && (event.key === " " || (target.matches("input") && event.key.startsWith("Arrow")))) return;
    if (!keys[event.key]) return;
    event.preventDefault();
    keys[event.key]();
  });
  await follow();
}

start();
