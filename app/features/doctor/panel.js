// @ts-check
// Why it went wrong at the frame shown: a button, progress, the likely cause, and on demand what else was tested.

/** @import { DoctorView, RerunTable, Suspect } from "../../views/web/static/views.js" */
/** @import { Html } from "../../views/web/static/preact.js" */

/** @param {DoctorView} view @param {Html} html */
export function doctor(view, html) {
  const answered = !view.progress && !view.problem && (view.answer || view.causes.length > 0);
  return html`<div class="explain${view.stretch ? "" : " live"}" data-cause>
    ${
      view.progress
        ? html`<button type="button" class="act live" data-do='{"do":"cancel_examination"}' title="Ends the examination without an answer.">Cancel</button>`
        : html`<button type="button" class="act live" data-do='{"do":"examine"}'
            title="Examines the frames before and after the one shown: which single cause explains best what went wrong there?">Diagnose</button>`
    }
    ${
      view.helped &&
      html`<button type="button" class="act live" data-do='{"do":"fork_with_remedy"}'
        title="Keeps this run, and runs on from before the stretch with the setting that helped most, as a branch.">Apply what helped</button>`
    }
    ${view.stretch && html`<h3>Cause<span>frames ${view.stretch[0]} to ${view.stretch[1]}</span></h3>`}
    ${view.progress && html`<div class="small" role="status">${view.progress}</div>`}
    ${view.problem && html`<div class="small" role="status">No answer: ${view.problem}.</div>`}
    ${answered && answer(view, html)}
  </div>`;
}

/** @param {DoctorView} view @param {Html} html */
function answer({ causes, answer, others, reruns, silent, left }, html) {
  const [first, ...more] = causes;
  return html`${
    first
      ? html`<div role="status"><b>The likely cause: ${first.name}.</b></div>
          <div><b>What to do:</b> ${withCode(first.remedy, html)}</div>
          <div class="small">${first.evidence} ${frames(first, html)}</div>`
      : html`<div role="status">${answer}</div>`
  }
  ${more.map((each, i) => suspect(each, i + 2, html))}
  <details class="small">
    <summary>What else was tested</summary>
    ${others.map((each, i) => suspect(each, causes.length + i + 1, html))}
    ${reruns.map((each) => table(each, html))}
    ${silent.length > 0 && html`<div>Not testable: ${silent.join(", ")}.</div>`}
    ${left.length > 0 && html`<div>Not tested, no time was left: ${left.join(", ")}.</div>`}
  </details>`;
}

/** @param {Suspect} each @param {number} place @param {Html} html */
const suspect = (each, place, html) => html`<div class="small">
    <b>${place}. ${each.name}</b> (${each.state}, ${Math.round(100 * each.strength)} % of the limit): ${each.evidence} ${each.undecided}
  </div>
  <div class="small">${frames(each, html)}</div>`;

/** @param {Suspect} each @param {Html} html */
const frames = (each, html) =>
  each.frames.map(
    (frame) =>
      html`<button type="button" class="frame" data-seek="${frame}" title="Click: go to frame ${frame}, which shows it.">frame ${frame}</button> `,
  );

/** @param {string} text @param {Html} html */
const withCode = (text, html) => text.split("`").map((part, i) => (i % 2 ? html`<code>${part}</code>` : part));

/** @param {RerunTable} of @param {Html} html */
const table = ({ first, last, answer, rows, left }, html) => html`<div>Rerun from frame ${first} to ${last}. ${answer}</div>
  ${
    rows.length > 0 &&
    html`<table>
      <tr>
        <th title="What was changed in the rerun; bold where it helps.">setting</th>
        <th class="number" title="Frames whose pose was found.">located</th>
        <th class="number" title="Segments that began in the stretch.">begun</th>
        <th title="Keys of the checks, and in how many frames each failed.">checks that failed</th>
      </tr>
      ${rows.map(
        (row) => html`<tr>
          <td>${row.helps ? html`<b>${row.option}</b>` : row.option}</td>
          <td class="number">${row.located} of ${row.frames}</td>
          <td class="number">${row.segments}</td>
          <td>${row.failures}</td>
        </tr>`,
      )}
    </table>`
  }
  ${left.length > 0 && html`<div>Not tried: ${left.join(", ")}.</div>`}`;
