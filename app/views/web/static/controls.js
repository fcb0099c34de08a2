// viser's panel in its frame, as wide as the pane and without viser's own 3-D scene: the page's theme, its keys, and labels that can be read (viser's have a contrast of 2.6 to 3.6).
import { keepFocus } from "./focus.js";
import { listen } from "./keyboard.js";
import { listenToPanels } from "./panels.js";

const PANEL = 384; // pixels that viser gives its panel
const ON_WHITE = "#00659c"; // in the dark, viser's own colours are bright enough
const LIGHT = {
  "color-custom-outline": ON_WHITE,
  "color-gray-filled": "#5f6870",
  "color-red-filled": "#c62828",
  "color-dimmed": "#565e66",
};
const STYLE = `
  :root:root { --mantine-color-dimmed: #b4bcc2 !important; }
  :root:root[data-mantine-color-scheme=light] { ${Object.entries(LIGHT)
    .map(([name, value]) => `--mantine-${name}: ${value} !important;`)
    .join(" ")} }
  div[style*="inset: 0px 0px 0px ${PANEL}px"] { display: none !important; }
  div[style*="width: ${PANEL}px"] { width: var(--pane) !important; }
  .mantine-Slider-markLabel { color: var(--mantine-color-dimmed); }
  [role=tab] { padding-inline: 2px !important; font-size: 12px !important; }
  .following :is(button:not([role=tab], [data-plot], [data-seek]), input, textarea, .mantine-Slider-root) { pointer-events: none; }
  [data-mantine-color-scheme=light] [role=tab][aria-selected=true], [data-mantine-color-scheme=light] [role=tab][aria-selected=true] * { color: ${ON_WHITE} !important; }`;

export function openControls(dark, press, command, tabOpened) {
  const frame = document.getElementById("controls");
  let painted = dark;
  // viser has its colours from this attribute, as all that is made with Mantine.
  const paint = (nowDark) => {
    painted = nowDark;
    frame.contentDocument?.documentElement?.setAttribute("data-mantine-color-scheme", nowDark ? "dark" : "light");
  };
  frame.addEventListener("load", () => {
    const style = frame.contentDocument.createElement("style");
    style.textContent = STYLE;
    frame.contentDocument.head.append(style);
    const root = frame.contentDocument.documentElement;
    new ResizeObserver(() => root.style.setProperty("--pane", `${frame.parentElement.clientWidth}px`)).observe(frame.parentElement);
    if (painted !== dark) paint(painted); // it turned while the frame was loaded
    listen(frame.contentWindow, press);
    listenToPanels(frame.contentDocument, command, tabOpened);
    keepFocus(frame.contentDocument);
  });
  frame.src = `viser/${dark ? "?darkMode" : ""}`;
  return { paint, follow: (following) => frame.contentDocument?.documentElement?.classList.toggle("following", following) };
}
