// @ts-check
// The left pane: tabs of what people read, drawn by the features' components (app/features/NAME/panel.js) from the view
// values that the server sends, and tabs that the page brings. A value comes once, and then its fields that have changed.
// A view whose tab is "#ID" has that element of the page for itself.
import { html, render } from "./preact.js";
import { element } from "./element.js";
import { listenToPanels } from "./panels.js";

/** @import { Child, Html } from "./preact.js" */
/** @typedef {{ name: string, tab: string, script: string }} Panel */
/** @typedef {(view: any, html: Html) => Child} Component */
/** @typedef {{ panels?: Panel[], views?: Record<string, object> }} News */

const KEYS = /** @type {Record<string, number>} */ ({ ArrowLeft: -1, ArrowRight: 1 });

/**
 * @param {(message: object) => void} command sends what a person asks for
 * @param {Record<string, HTMLElement>} own tabs of the page, behind those of the features
 * @param {(tab: string) => void} chosen is called when another tab is open
 * @param {Record<string, HTMLElement>} offered tabs in front, hidden until they are offered
 */
export function openPanes(command, own, chosen = () => {}, offered = {}) {
  const place = /** @type {HTMLElement} */ (document.getElementById("panels"));
  const bar = element("div", "tabs");
  place.prepend(bar);
  bar.setAttribute("role", "tablist");
  /** @type {Record<string, HTMLElement>} */
  const pages = {};
  /** @type {Record<string, any>} */
  const values = {};
  /** @type {Record<string, { component: Component, place: HTMLElement }>} */
  const views = {};
  let open = "";
  let occasion = ""; // of the tab that is there only sometimes

  /** @param {string} name */
  function choose(name) {
    open = name;
    for (const tab of tabs()) {
      tab.setAttribute("aria-selected", String(tab.textContent === name));
      tab.tabIndex = tab.textContent === name ? 0 : -1;
    }
    for (const [each, page] of Object.entries(pages)) {
      page.classList.toggle("away", each !== name);
      page.inert = each !== name;
    }
    chosen(name);
  }
  const tabs = () => /** @type {HTMLElement[]} */ ([...bar.children]);

  /** @param {string} name @param {HTMLElement} page */
  function addTab(name, page) {
    pages[name] = page;
    if (page.parentElement !== place) place.append(page); // a frame that is moved is loaded again
    page.classList.add("page", "away");
    page.id ||= `tab-${name}`;
    Object.assign(page, { role: "tabpanel", ariaLabel: name });
    const tab = bar.appendChild(element("button", "", name));
    Object.assign(tab, { type: "button", role: "tab" });
    tab.setAttribute("aria-controls", page.id);
    tab.addEventListener("click", () => choose(name));
    return tab;
  }
  bar.addEventListener("keydown", ({ key }) => {
    if (!KEYS[key]) return;
    const there = tabs().filter(({ hidden }) => !hidden);
    const next = there.at((there.indexOf(/** @type {HTMLElement} */ (document.activeElement)) + KEYS[key]) % there.length);
    choose(next?.textContent ?? open);
    next?.focus();
  });
  listenToPanels({ body: place }, command, () => {});
  const places = [place];

  /** @param {string} id */
  function placeOfItsOwn(id) {
    const own = /** @type {HTMLElement} */ (document.querySelector(id));
    listenToPanels({ body: own }, command, () => {});
    places.push(own);
    return own;
  }

  /** @param {Panel[]} listed */
  function make(listed) {
    for (const [name, page] of Object.entries(offered)) addTab(name, page).hidden = true;
    for (const { name, tab, script } of listed) {
      if (!tab.startsWith("#") && !pages[tab]) addTab(tab, element("div"));
      const view = tab.startsWith("#") ? placeOfItsOwn(tab) : pages[tab].appendChild(element("div"));
      view.dataset.view = name;
      import(new URL(`panels/${script}`, document.baseURI).href).then((made) => {
        views[name] = { component: made[name], place: view };
        draw(name);
      });
    }
    for (const [name, page] of Object.entries(own)) addTab(name, page);
    choose(Object.keys(pages).find((name) => !(name in offered)) ?? "");
  }

  /** @param {string} name */
  function draw(name) {
    if (views[name] && values[name]) render(views[name].component(values[name], html), views[name].place);
  }

  return {
    choose,
    /**
     * Shows a tab that is there only sometimes, in front where there is something new in it.
     * @param {string} name
     * @param {string} now what is in it; empty for nothing, and then the tab is not there
     */
    offer(name, now) {
      const tab = tabs().find(({ textContent }) => textContent === name);
      if (!tab || (now === occasion && tab.hidden === !now)) return;
      occasion = now;
      tab.hidden = !now;
      if (now) choose(name);
      else if (open === name) choose(tabs().find(({ hidden }) => !hidden)?.textContent ?? "");
    },
    /** @param {boolean} following whether somebody else is in control */
    follow(following) {
      for (const each of places) each.classList.toggle("following", following);
    },
    /** @param {News} news */
    show({ panels, views: changed = {} }) {
      if (panels && !open) make(panels);
      for (const [name, value] of Object.entries(changed)) {
        values[name] = { ...values[name], ...value };
        draw(name);
      }
    },
  };
}
