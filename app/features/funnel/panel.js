// @ts-check
// A row at the image: what becomes of its features, a number for each stage; the one that limits is lit, with the reason.

/** @import { FunnelStage, FunnelView, MethodFunnel } from "../../views/web/static/views.js" */
/** @import { Html } from "../../views/web/static/preact.js" */

const MEANINGS = /** @type {Record<string, string>} */ ({
  detected: "Tracks after the last detection of corners",
  tracked: "Of these, tracked into this image",
  "with depth": "Of these, with a known 3-D point, so that they take part in the pose",
  inliers: "Of these, used by the pose",
});

/** @param {FunnelView} view @param {Html} html */
export function funnel({ methods }, html) {
  return html`${methods.map((each) => method(each, html))}`;
}

/** @param {MethodFunnel} of @param {Html} html */
const method = ({ label, colour, frame, stages }, html) => html`<div class="funnel" style="--colour:${colour}">
    <b title="at frame ${frame}">${label}</b>
    ${stages.map((each, i) => html`${i > 0 && html`<span class="quiet">›</span>`}${stage(each, html)}`)}
  </div>`;

/** @param {FunnelStage} of @param {Html} html */
const stage = ({ name, count, limits, why }, html) => html`<span class="${limits ? "stage limits" : "stage"}"
    title="${[MEANINGS[name], limits && "this limits the inliers most", why].filter(Boolean).join("; ")}">
    <span class="count">${count}</span> ${name}${limits && why && html` <span class="why">${why}</span>`}
  </span>`;
