// viser's panel in its frame: the page's theme, its keys, and labels that can be read (viser's have a contrast of 3.3).
import { listen } from "./keyboard.js";

const LABELS = { dark: "#b4bcc2", light: "#565e66" };

export function openControls(dark, command) {
  const frame = document.getElementById("controls");
  frame.addEventListener("load", () => {
    const style = frame.contentDocument.createElement("style");
    style.textContent = `:root:root { --mantine-color-dimmed: ${LABELS[dark ? "dark" : "light"]} !important; }`;
    frame.contentDocument.head.append(style);
    listen(frame.contentWindow, command);
  });
  frame.src = `viser/${dark ? "?darkMode" : ""}`;
}
