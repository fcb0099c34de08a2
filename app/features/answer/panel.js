// @ts-check
// One line on top of the page for the frame shown: what went wrong, since when, why, and what to do.

/** @import { AnswerView } from "../../views/web/static/views.js" */
/** @import { Html } from "../../views/web/static/preact.js" */

/** @param {AnswerView} view @param {Html} html */
export function answer({ tone, text, working, diagnose, thorough, applies, show }, html) {
  /** @param {string} name @param {object} command @param {string} title @param {string} kind */
  const act = (name, command, title, kind = "act live") =>
    html`<button type="button" class="${kind}" data-do="${JSON.stringify(command)}" title="${title}">${name}</button>`;
  return html`<div class="answer ${text && tone}">
    <div class="line" role="status" aria-live="${working ? "off" : "polite"}" title="${text}" tabindex="${text ? 0 : undefined}">${text}</div>
    ${working && act("Cancel", { do: "cancel_examination" }, "Ends the examination without an answer")}
    ${
      diagnose !== null &&
      !thorough &&
      act(
        "Diagnose",
        { do: "examine", at: diagnose },
        `Which single change explains best what went wrong at frame ${diagnose}?`,
        "act live main",
      )
    }
    ${
      thorough &&
      act(
        "Try settings",
        { do: "examine", at: diagnose, thorough: true },
        "Examines the same frames again, with up to three minutes: enough for other settings",
      )
    }
    ${applies && act("Apply", { do: "fork_with_remedy" }, "Keeps this run, and runs on from before these frames with that setting, as a branch", "act live main")}
    ${show !== null && act("Show", { do: "seek", index: show }, `Goes to frame ${show}`, "")}
  </div>`;
}
