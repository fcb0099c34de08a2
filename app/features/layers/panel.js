// @ts-check
// The legend at the image, in one row.

/** @import { LegendView } from "../../views/web/static/views.js" */
/** @import { Html } from "../../views/web/static/preact.js" */

/** @param {LegendView} view @param {Html} html */
export function legend({ title, items }, html) {
  const all = items
    .map(({ text }) => text)
    .filter(Boolean)
    .join(", ");
  return html`<p class="legend" title="${title && `${title}: ${all}`}" hidden=${!items.length}>
    <span class="quiet">${title}</span>
    ${items.map(({ colour, text }) => html`<span class="${text ? "" : "between"}"><i style="--colour:${colour}"></i>${text}</span>`)}
  </p>`;
}
