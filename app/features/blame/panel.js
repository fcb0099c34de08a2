// @ts-check
// Which points decided this pose: a button, and of each method the answer and the parts that were left out.

/** @import { BlameRow, BlameView, MethodBlame } from "../../views/web/static/views.js" */
/** @import { Html } from "../../views/web/static/preact.js" */

/** @param {BlameView} view @param {Html} html */
export function blame({ possible, frame, doing, methods, silent }, html) {
  const answered = methods.length > 0 || silent.length > 0;
  return html`<details class="live">
    <summary>What decided this pose</summary>
    <div class="explain">
      <button type="button" class="act" data-do='{"do":"ask_blame"}' disabled="${!possible || Boolean(doing)}"
        title="Leaves tracks, groups of them, keyframes, priors and sensors out of what each method solved at this frame.">Which points decided this pose?</button>
      ${doing && html`<div class="small" role="status">${doing[0].toUpperCase()}${doing.slice(1)} …</div>`}
      ${!answered && !doing && html`<div class="small">Lists how far the pose moves without each part of what the methods solved.</div>`}
      ${methods.map((each) => method(each, frame, html))}
      ${silent.map((reason) => html`<div class="small">${reason}</div>`)}
    </div>
  </details>`;
}

/** @param {MethodBlame} of @param {number} shown @param {Html} html */
const method = ({ label, colour, frame, said, rows }, shown, html) => html`<h3 class="method" style="--colour:${colour}">
    ${label}${frame !== shown && html`<span>its newest pose, at frame ${frame}</span>`}
  </h3>
  ${said.map((sentence) => html`<div>${sentence}</div>`)}
  <table>
    <tr>
      <th title="tracks, keyframes, the prior or a sensor; a click shows tracks in the image, or goes to the frame">left out</th>
      <th class="number" title="from where the pose would be without it to where it is">moved the pose by</th>
    </tr>
    ${rows.map((row) => html`<tr><td>${part(row, html)}</td><td class="number">${row.size}</td></tr>`)}
  </table>`;

/** @param {BlameRow} row @param {Html} html */
function part({ name, select, seek }, html) {
  if (select)
    return html`<button type="button" class="frame" data-select="${select}" title="Click: show these tracks in the image.">${name}</button>`;
  if (seek !== null)
    return html`<button type="button" class="frame" data-seek="${seek}" title="Click: go to frame ${seek}.">${name}</button>`;
  return name;
}
