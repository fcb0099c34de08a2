// The mode Compare: the run that is shown (A) and another one (B), frame by frame: where they part first, their errors, the
// images of both with their tracks, and the distance between them. Rerun draws both trajectories.
import { element } from "./element.js";
import { drawCurves } from "./compare_curves.js";
import { locatedTexts } from "./located.js";
import { published } from "./published.js";
import { makeSwipe } from "./swipe.js";

const AGAIN_MS = 1000; // between two looks at a run that goes on
const place = document.getElementById("compare");

// `command` asks the session for something, `answer` gives what the server answers at an address, and `openRuns` opens the
// runs table.
export function makeCompare(command, answer, modes, openRuns) {
  const head = place.appendChild(element("div", "pair"));
  const first = place.appendChild(element("div", "first"));
  const numbers = place.appendChild(element("div", "scrolled"));
  const swipe = makeSwipe(place.appendChild(element("figure", "swipe")));
  const curves = place.appendChild(element("div", "curves"));
  let state = null;
  let found = null;
  let asked = "";
  let askedAt = 0;
  let due = null;

  function follow(next) {
    state = next;
    const shown = modes.mode === "compare" && !document.body.dataset.home;
    place.hidden = !shown;
    if (!shown) return;
    const key = JSON.stringify([next.compared, next.branches, next.run, next.compared && next.computed]);
    if (key !== asked) load(key);
    if (found || !next.compared) frame();
  }

  // Not more often than once a second; the latest key is always asked for in the end.
  function load(key) {
    clearTimeout(due);
    const wait = askedAt + AGAIN_MS - performance.now();
    if (wait > 0 && found) {
      due = setTimeout(() => state && follow(state), wait);
      return;
    }
    [asked, askedAt] = [key, performance.now()];
    answer(state.compared ? "comparison" : "runs").then((found) => found && key === asked && paint(found));
  }

  function paint(answer) {
    found = state.compared ? answer : null;
    const source = answer.rows.find(({ shown }) => shown)?.source;
    const runs = answer.rows.filter(
      ({ kind, shown, source: of }) => kind === "live" || shown || (of === source && !["sweep", "experiment"].includes(kind)),
    );
    choose(runs, answer.numbers);
    for (const part of [first, numbers, curves]) part.hidden = !found;
    const methods = state.methods.map(({ label, name }) => [name, label]);
    swipe.show(!published && (found !== null || methods.length > 1)); // the server draws its images
    swipe.methods(methods, !found);
    if (found) {
      listFirst();
      const [a, b] = answer.numbers.map((number) => row(answer, number));
      numbers.replaceChildren(table(answer, a, b));
    }
    frame();
  }

  // The row of a branch; a recorded run has another key than its branch.
  const row = ({ rows, branches }, number) => rows.find(({ key }) => key === branches[number]) ?? rows[0];

  function choose(runs, pair) {
    if (runs.length < 2) {
      const button = element("button", "button", "Choose two runs");
      button.type = "button";
      button.addEventListener("click", openRuns);
      head.replaceChildren(
        element("p", "", "One run is open. Fork it (Methods: change a setting, press Fork), or select two runs in the runs table."),
        button,
      );
      return;
    }
    const keys = pair ? pair.map((number) => found.branches[number]) : [runs.find(({ shown }) => shown)?.key ?? runs[0].key, ""];
    const lists = ["A", "B"].map((name, i) => list(name, runs, keys[i]));
    const again = () => {
      const [a, b] = lists.map((each) => each.lastElementChild.value);
      if (a && b && a !== b) command({ do: "compare_runs", a, b });
    };
    for (const each of lists) each.addEventListener("change", again);
    if (document.activeElement?.closest("#compare .pair")) return; // a list that is open stays
    head.replaceChildren(...lists);
  }

  function list(name, runs, chosen) {
    const label = element("label", `side-${name.toLowerCase()}`, name);
    const select = label.appendChild(document.createElement("select"));
    select.ariaLabel = `Run ${name}`;
    if (!chosen) select.append(new Option("choose a run", ""));
    select.append(...runs.map(({ key, name }) => new Option(name, key, false, key === chosen)));
    return label;
  }

  function listFirst() {
    const { first: list, frames, apart, done, finished, methods, thinned } = found;
    const compared = frames[1] - frames[0] + 1;
    const parts = [];
    if (list.length) {
      const [{ frame, lines, more }, ...later] = list;
      const line = element("p", "headline", "First difference: ");
      line.append(go(frame));
      parts.push(line, element("p", "", `${lines.join("; ")}${more ? `; and ${more} more` : ""}.`));
      const details = element("details");
      details.append(
        element("summary", "", `They differ at ${apart} of ${done} frames.${later.length ? " What differs later for the first time" : ""}`),
      );
      for (const each of later) {
        const entry = element("p");
        entry.append(go(each.frame), ` ${each.lines.join("; ")}${each.more ? `; and ${each.more} more` : ""}`);
        details.append(entry);
      }
      parts.push(details);
    } else parts.push(element("p", "headline", finished ? `No difference in ${compared} frames.` : "No difference so far."));
    if (thinned) parts.push(element("p", "quiet", `The history no longer has the tracks of ${thinned} frames: the rest was compared.`));
    if (!finished) parts.push(element("p", "quiet", `Comparing: ${done} of ${compared} frames.`));
    if (!first.contains(document.activeElement) || methods) first.replaceChildren(...parts);
  }

  function go(frame) {
    const button = element("button", "link", `frame ${frame}`);
    Object.assign(button, { type: "button", title: `Goes to frame ${frame}` });
    button.addEventListener("click", () => command({ do: "seek", index: frame }));
    return button;
  }

  function frame() {
    if (!published) swipe.at(found?.numbers ?? [state.branch, state.branch], state.index);
    if (found) drawCurves(curves, found.curves, found.total, state.index, (index) => command({ do: "seek", index }));
  }

  return { follow };
}

// What is known of A and B side by side.
function table({ columns, common }, a, b) {
  const made = element("table");
  const line = (name, left, right, hint = "") => {
    const row = made.appendChild(element("tr"));
    row.append(Object.assign(element("th", "", name), { scope: "row", title: hint }), element("td", "", left), element("td", "", right));
  };
  const head = made.appendChild(element("tr"));
  head.append(
    element("td"),
    ...["A", "B"].map((name) => Object.assign(element("th", `side-${name.toLowerCase()}`, name), { scope: "col" })),
  );
  line("Differs in", a.differs.join("; ") || "defaults", b.differs.join("; ") || (b.parent === a.key ? "nothing" : "defaults"));
  const text = (cells) =>
    cells.map(({ variant, text, alignment }) => [variant, text, alignment].filter(Boolean).join(" ")).join(", ") || "–";
  columns.forEach(({ label, alignment }, i) => line(`${label}, ATE${alignment ? ` ${alignment}` : ""}`, text(a.ate[i]), text(b.ate[i])));
  for (const { label, a, b } of common) line(`${label}, common frames`, a, b, "ATE over the frames at which both have a pose");
  const [left, right] = [a, b].map((row) => locatedTexts(row).join(", "));
  line("Located", left, right, "Share of the frames of each method at which it tracked");
  const events = ({ events, worst }) => (events === null ? "–" : events ? `${events} (worst: ${worst})` : "0");
  line("Events", events(a), events(b), "Losses and warnings");
  return made;
}
