// viser's panel in its frame, as wide as the pane and without viser's own 3-D scene: the page's theme, its keys, and labels that can be read (viser's have a contrast of 2.6 to 3.6).
import { keepFocus } from "./focus.js";
import { listen } from "./keyboard.js";
import { listenToPanels } from "./panels.js";

const LABELS = { dark: "#b4bcc2", light: "#565e66" };
const PANEL = 384; // pixels that viser gives its panel
const ON_WHITE = "#00659c",
  GRAY = "#5f6870",
  RED = "#c62828"; // in the dark, viser's own are bright enough

export function openControls(dark, press, command, tabOpened) {
  const frame = document.getElementById("controls");
  frame.addEventListener("load", () => {
    const style = frame.contentDocument.createElement("style");
    const colour = `${LABELS[dark ? "dark" : "light"]} !important`;
    const own = { "color-custom-outline": ON_WHITE, "color-gray-filled": GRAY, "color-red-filled": RED };
    const accents = dark ? [] : Object.entries(own).map(([name, value]) => `--mantine-${name}: ${value} !important;`);
    style.textContent = `:root:root { --mantine-color-dimmed: ${colour}; ${accents.join(" ")} }
      div[style*="inset: 0px 0px 0px ${PANEL}px"] { display: none !important; }
      div[style*="width: ${PANEL}px"] { width: var(--pane) !important; }
      .mantine-Slider-markLabel { color: ${colour}; }
      [role=tab] { padding-inline: 2px !important; font-size: 12px !important; }
      .following :is(button:not([role=tab], [data-plot], [data-seek]), input, textarea, .mantine-Slider-root) { pointer-events: none; }
      ${dark ? "" : `[role=tab][aria-selected=true], [role=tab][aria-selected=true] * { color: ${ON_WHITE} !important; }`}`;
    frame.contentDocument.head.append(style);
    const root = frame.contentDocument.documentElement;
    new ResizeObserver(() => root.style.setProperty("--pane", `${frame.parentElement.clientWidth}px`)).observe(frame.parentElement);
    listen(frame.contentWindow, press);
    listenToPanels(frame.contentDocument, command, tabOpened);
    keepFocus(frame.contentDocument);
  });
  frame.src = `viser/${dark ? "?darkMode" : ""}`;
  return { follow: (following) => frame.contentDocument?.documentElement?.classList.toggle("following", following) };
}
