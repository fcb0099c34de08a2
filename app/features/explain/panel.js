// @ts-check
// The tab Explain: a verdict for each method, what is folded below it, and the events of the run.

/** @import { CheckRow, EventRow, EventsView, ExplainView, MethodCard } from "../../views/web/static/views.js" */
/** @import { Html } from "../../views/web/static/preact.js" */

/** @param {ExplainView} view @param {Html} html */
export function explain(view, html) {
  const { cards } = view;
  if (view.frame < 0)
    return html`<div class="explain">
      ${view.waiting || "No frame is processed yet. Press Play, or step forward (→)."} ${notes(view, html)}
    </div>`;
  return html`<div class="explain">
      <h3>Frame ${view.frame}<span>${view.kind} · ${view.time_s.toFixed(2)} s</span></h3>
      ${
        view.skipped &&
        html`<div class="card lost" style="--colour:var(--lost)"><div class="top"><span class="headline">Frame skipped</span></div>${view.skipped}</div>`
      }
      ${cards.map((card) => verdict(card, view.plotted, html))}
      ${
        view.settings.length > 0 &&
        html`<div class="small" title="Default → value in this run; change them under Controls, in the tab Methods.">
          Settings other than the defaults: <b>${view.settings.join(", ")}</b>
        </div>`
      }
      ${notes(view, html)}
    </div>
    <details><summary>All checks</summary><div class="explain">${checks(view, html)}</div></details>
    <details><summary>Steps and times</summary><div class="explain">${cards.map((card) => stages(card, html))}</div></details>
    <details><summary>Tracks and numbers</summary><div class="explain">${cards.map((card) => facts(card, view.plotted, html))}</div></details>
    <div class="explain">
      <button type="button" class="act" data-do="${JSON.stringify({ do: "step_to_event", forwards: true, alarming: true })}"
        title="The next frame with a warning or a loss. Frames are computed until there is one.">Next problem</button>
    </div>`;
}

/** @param {EventsView} view @param {Html} html */
export function events(view, html) {
  const none = view.computed ? `No events in ${view.computed} frames: no loss, jump or warning so far.` : "No frame is processed yet.";
  return html`<div class="explain">
    <h3>Events<span>n / N: next, previous</span></h3>
    ${view.earlier > 0 && html`<div class="small">${view.earlier} earlier</div>`}
    ${view.rows.map((row) => event(row, row.frame === view.frame, html))}
    ${!view.rows.length && html`<div class="small">${none}</div>`}
    ${view.later > 0 && html`<div class="small">${view.later} later</div>`}
    ${view.omitted > 0 && html`<div class="small">${view.omitted} more of the same kinds are not listed.</div>`}
  </div>`;
}

/** @param {ExplainView} view @param {Html} html */
const notes = (view, html) => view.notes.map((note) => html`<span class="small">${note}</span>`);

/** @param {MethodCard} card @param {string[]} plotted @param {Html} html */
function verdict({ label, colour, severity, headline, detail, tag, when, decisive, failed, ongoing }, plotted, html) {
  return html`<div class="card ${severity}" style="--colour:${colour}">
    <div class="top">
      <span class="name">${label}</span><span class="headline">${headline}</span>${when && html`<span>${when}</span>`}<span class="tint">${tag}</span>
    </div>
    ${detail && html`<div>${detail[0].toUpperCase()}${detail.slice(1)}.</div>`}
    ${
      decisive &&
      html`<button type="button" ...${plot(decisive.quantity, plotted)} title="${decisive.quantity}. Click: plot over time."><span class="small">${[decisive.numbers, "plot"].filter(Boolean).join(" · ")}</span></button>`
    }
    ${failed.map((each) => check(each, plotted, html))}
    ${ongoing.map(
      (since) => html`<button type="button" data-seek="${since.frame}" title="${since.sentence} Click: go to frame ${since.frame}.">
        <span class="mark warning">!</span><span class="text">${since.headline} since frame ${since.frame}</span>
      </button>`,
    )}
  </div>`;
}

/** @param {ExplainView} view @param {Html} html */
function checks({ cards, plotted, thinned }, html) {
  const made = cards.filter(({ details }) => details?.groups.length);
  return html`
    ${thinned && html`<div class="small">Tracks and residuals of this frame are no longer kept, so that the history stays small.</div>`}
    ${!made.length && "No method made a check at this frame."}
    ${made.map(
      ({ label, colour, details }) => html`<h3 class="method" style="--colour:${colour}">${label}</h3>
        ${details?.groups.map(
          (group) => html`${group.question && html`<div class="question"><b>${group.question}</b> ${group.text}</div>`}
            ${group.checks.map((each) => check(each, plotted, html))}
            ${
              group.crowd.length > 0 &&
              html`<div class="crowd">Not significant (${group.crowd.length} tested):</div>
                <div class="chips">${group.crowd.map(
                  (each) =>
                    html`<button type="button" ...${plot(each.quantity, plotted)} title="${each.sentence} Click: plot over time.">${each.name}</button>`,
                )}</div>`
            }`,
        )}`,
    )}`;
}

/** @param {CheckRow} row @param {string[]} plotted @param {Html} html */
const check = (row, plotted, html) => html`<button type="button" ...${plot(row.quantity, plotted)}
    title="${row.quantity}: ${row.hint}. Click: plot over time.">
    <span class="mark ${row.tint}">${row.mark}</span><span class="text">${row.sentence}<span class="small">${row.numbers}</span></span>
  </button>`;

/** @param {MethodCard} card @param {Html} html */
function stages({ label, colour, details }, html) {
  if (!details?.stages.length) return null;
  return html`<h3 class="method" style="--colour:${colour}">${label}</h3>
    ${details.uses && html`<div class="small">depends on ${details.uses}</div>`}
    ${details.stages.map(
      ({ name, text, ms }, i) => html`<div class="line" title="stage ${i + 1} of ${details.stages.length}">
        <span class="mark quiet">${i + 1}</span><span class="text"><b>${name}</b>${text && `: ${text}`}</span><span class="number">${ms} ms</span>
      </div>`,
    )}`;
}

/** @param {MethodCard} card @param {string[]} plotted @param {Html} html */
function facts({ label, colour, details }, plotted, html) {
  if (!details?.facts.length) return null;
  return html`<h3 class="method" style="--colour:${colour}">${label}</h3>
    ${details.facts.map((fact) => {
      const words = html`<span class="label">${fact.label}</span><span class="text">${fact.text}</span>`;
      if (!fact.quantity) return html`<div class="line">${words}</div>`;
      return html`<button type="button" ...${plot(fact.quantity, plotted)} title="${fact.quantity}. Click: plot over time.">${words}</button>`;
    })}`;
}

/** @param {string} quantity @param {string[]} plotted */
const plot = (quantity, plotted) => ({ "data-plot": quantity, "aria-pressed": String(plotted.includes(quantity)) });

/** @param {EventRow} row @param {boolean} here @param {Html} html */
function event(row, here, html) {
  return html`<button type="button" class="${here ? "here" : ""}" data-seek="${row.frame}" aria-current="${here ? "true" : undefined}"
      title="${row.help} Click: go to frame ${row.frame}.">
      <span class="frames">${row.frames}</span><span class="mark ${row.severity}">●</span>
      <span class="text">${row.label && html`<b>${row.label}</b> · `}${row.sentence}</span>
    </button>
    ${
      row.alarming &&
      html`<button type="button" class="why live" data-doctor="${row.frame}" title="Which single change explains best what went wrong at frame ${row.frame}?"><span class="text">Diagnose</span></button>`
    }`;
}
