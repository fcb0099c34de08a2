// The mode Compare: of the run that is shown (A) and another one (B) the verdict, where their paths part, what each is better
// in, and how far they are apart. Rerun draws both paths.
import { element } from "./element.js";
import { drawCurves } from "./compare_curves.js";
import { makePlace } from "./compare_place.js";
import { published } from "./published.js";

const AGAIN_MS = 1000; // between two looks at a run that goes on
const place = document.getElementById("compare");
const VERDICTS = { a: "A is better", b: "B is better", same: "the same", "cannot tell": "cannot tell", "": "" };

// `command` asks the session for something, `answer` gives what the server answers at an address, and `openRuns` opens the
// runs table.
export function makeCompare(command, answer, modes, openRuns) {
  const head = place.appendChild(element("div", "pair"));
  const verdict = place.appendChild(element("p", "verdict"));
  const parting = makePlace(place.appendChild(element("section", "parting")), seek);
  const numbers = place.appendChild(element("div", "scrolled"));
  const curves = place.appendChild(element("div", "curves"));
  const details = place.appendChild(element("details"));
  let state = null;
  let found = null;
  let asked = "";
  let askedAt = 0;
  let due = null;
  let rows = []; // of the runs, as the server sent them last
  let proposed = ""; // the fork whose comparison was begun by itself

  function seek(index) {
    command({ do: "seek", index });
  }

  function follow(next) {
    state = next;
    const shown = modes.mode === "compare" && !document.body.dataset.home;
    place.hidden = !shown;
    if (!shown) return;
    const key = JSON.stringify([next.compared, next.branches, next.run, next.compared && next.computed]);
    if (key !== asked) load(key);
    if (found || !next.compared) frame();
    propose(next);
  }

  // A fork is compared with what it was forked from, once, when it stands still.
  function propose({ compared, playing, target, people, run }) {
    const fork = rows.find(({ shown }) => shown);
    const parent = fork && rows.find(({ key }) => key === fork.parent);
    const drives = people?.driving || (people?.driver === null && people.may_drive);
    if (published || compared || playing || target !== null || !parent || !drives) return;
    const key = JSON.stringify([run, fork.key]);
    if (key === proposed) return;
    proposed = key;
    command({ do: "compare_runs", a: parent.key, b: fork.key });
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
    rows = answer.rows;
    const source = answer.rows.find(({ shown }) => shown)?.source;
    const runs = answer.rows.filter(
      ({ kind, shown, source: of }) => kind === "live" || shown || (of === source && !["sweep", "experiment"].includes(kind)),
    );
    choose(runs, answer.numbers);
    for (const part of [verdict, numbers, curves, details]) part.hidden = !found?.view;
    parting.show(found?.view ?? null, found?.pictures);
    if (found?.view) {
      const { better, sentence } = found.view;
      verdict.className = `verdict side-${better}`;
      verdict.textContent = sentence;
      numbers.replaceChildren(table(found));
      if (!details.contains(document.activeElement)) listDifferences();
    }
    frame();
    propose(state);
  }

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

  // From which frame on numbers differ, be it by a setting: long before paths part.
  function listDifferences() {
    const { first, frames, apart, done, finished, thinned } = found;
    const compared = frames[1] - frames[0] + 1;
    const parts = first.map(({ frame, lines, more }) => {
      const entry = element("p");
      entry.append(go(frame), ` ${lines.join("; ")}${more ? `; and ${more} more` : ""}`);
      return entry;
    });
    const how = !finished
      ? `Comparing all numbers: ${done} of ${compared} frames`
      : first.length
        ? `Numbers differ at ${apart} of ${done} frames, first at frame ${first[0].frame}`
        : `All numbers are the same in ${compared} frames`;
    if (thinned) parts.push(element("p", "", `The history no longer has the tracks of ${thinned} frames: the rest was compared.`));
    details.replaceChildren(element("summary", "", how), ...parts);
  }

  function go(frame) {
    const button = element("button", "link", `frame ${frame}`);
    Object.assign(button, { type: "button", title: `Goes to frame ${frame}` });
    button.addEventListener("click", () => seek(frame));
    return button;
  }

  function frame() {
    if (!found?.view) return;
    if (!published) parting.at(found.numbers, state.run, state.index); // the server draws the images
    drawCurves(curves, found.view.curves, found.total, state.index, seek);
  }

  return { follow };
}

// Each quantity once: those of a method below its name, and what the whole runs differ in.
function table({ view, rows, branches, numbers }) {
  const made = element("table");
  const [a, b] = numbers.map((number) => rows.find(({ key }) => key === branches[number]) ?? rows[0]);
  const line = (label, cells, kind = "") => {
    const row = made.appendChild(element("tr", kind));
    row.append(Object.assign(element("th", "", label), { scope: "row" }), ...cells);
  };
  const cell = (text, bold) => element("td", bold ? "best" : "", text || "–");
  const head = made.appendChild(element("tr"));
  head.append(element("td"));
  for (const name of ["A", "B", "Verdict"]) {
    const side = name.length === 1 ? `side-${name.toLowerCase()}` : "";
    head.append(Object.assign(element("th", side, name), { scope: "col" }));
  }
  const nothing = b.parent === a.key ? "nothing" : "defaults";
  line("Differs in", [cell(a.differs.join("; ") || "defaults"), cell(b.differs.join("; ") || nothing), element("td")]);
  let of = "";
  for (const { of: method, label, a, b, better, why } of view.metrics) {
    if (method !== of) made.append(heading(method));
    of = method;
    line(label, [cell(a, better === "a"), cell(b, better === "b"), element("td", `side-${better}`, VERDICTS[better])]);
    if (why) made.append(wide(why));
  }
  return made;
}

function heading(method) {
  const row = element("tr", "of");
  row.append(Object.assign(element("th", "", method || "Whole run"), { scope: "rowgroup", colSpan: 4 }));
  return row;
}

function wide(text) {
  const row = element("tr", "why");
  row.append(Object.assign(element("td", "quiet", text), { colSpan: 4 }));
  return row;
}
