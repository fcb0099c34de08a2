// The start screen: the demo, a recording by its path, calibration, lessons, and all runs. Without a run it is the page;
// over a run it is opened by the name in the bar, and closed by Escape. What fails is said where it was asked for.
import { element } from "./element.js";
import { makeRuns } from "./runs_table.js";

const at = (id) => document.getElementById(id);
const screen = at("start");
const MOST_NAMED = 5; // unfinished runs

// `command` asks the session for something, `changed` is called when the screen was opened or closed by hand.
export function makeStart(command, modes, changed) {
  let open = false; // by hand
  let state = null;
  let asked = null; // what the session was asked for here: { fault, notice, refused, run, done }
  let lesson = null; // the next one
  const taken = new Set(); // numbers of the notices that are shown here
  const runs = makeRuns(command, ask, close, compared);
  const needed = () => ["empty", "failed"].includes(state?.phase) && modes.mode !== "learn";

  // Asks for what opens another run; `fault` is the element that shows what went wrong, `done` says that it is there.
  function ask(fault, message, done = () => modes.set("debug") ?? true) {
    if (!state) return;
    for (const each of screen.querySelectorAll(".fault")) each.textContent = "";
    asked = {
      fault,
      notice: state.notices.at(-1)?.number ?? 0,
      refused: state.refused[0],
      run: message.do === "compare_runs" ? -1 : state.run,
      done,
    };
    command(message);
  }

  function show(wanted) {
    open = wanted;
    changed();
    if (wanted) (screen.querySelector("[autofocus]") ?? at("back")).focus();
    else if (screen.contains(document.activeElement)) at("home").focus();
  }
  function close() {
    if (open) show(false);
  }
  function compared() {
    modes.set("compare");
    close();
  }

  // The notices that are not shown here.
  function heard(next) {
    if (asked) {
      const fault = next.notices.find(({ number, kind }) => number > asked.notice && kind === "error");
      const refused = next.refused[0] > asked.refused ? next.refused[1] : "";
      if (fault) taken.add(fault.number);
      if (fault || refused) {
        asked.fault.textContent = fault?.text ?? refused;
        asked = null;
      }
    }
    return next.notices.filter(({ number }) => !taken.has(number));
  }

  function follow(next) {
    const before = state;
    state = next;
    if (asked && next.run > asked.run && next.phase === "ready") {
      const before = asked;
      asked = null; // `done` may come back here
      if (before.done(next)) [open, before.fault.textContent] = [false, ""];
      else asked = before;
    }
    const computing = asked && next.target !== null;
    const waiting = computing || (asked && next.phase === "opening");
    const shown = open || needed() || Boolean(waiting);
    if (next.phase === "failed" && before?.phase !== "failed" && !asked) failed(next);
    if (waiting)
      asked.fault.textContent = computing
        ? `Computing frames up to ${next.target}: ${next.computed} done`
        : `${next.activity ?? "opening"} …`;
    asked?.fault.classList.toggle("busy", Boolean(waiting));
    screen.hidden = !shown;
    document.body.dataset.home = shown ? "shown" : "";
    at("home").setAttribute("aria-expanded", String(shown));
    at("back").hidden = next.phase !== "ready";
    runs.follow(shown, next, (found) => paint(found));
  }

  // Runs that were killed are in no row of the table: a person is asked before anything is written into their folders.
  function nameUnfinished(names) {
    at("unfinished").hidden = !names.length;
    const more = names.length > MOST_NAMED ? ` and ${names.length - MOST_NAMED} more` : "";
    at("unfinished").firstElementChild.textContent =
      `Not finished, as the program was stopped: ${names.slice(0, MOST_NAMED).join(", ")}${more}.`;
  }

  // The source of the command line, which could not be opened.
  function failed({ source, notices }) {
    at("path").value = source;
    at("path-fault").textContent = notices.findLast(({ kind }) => kind === "error")?.text ?? "";
  }

  function paint({ recent, lessons, unfinished }) {
    nameUnfinished(unfinished);
    at("recent").hidden = !recent.length;
    at("recent").replaceChildren("Recent: ", ...recent.slice(0, 5).map((source) => link(nameOf(source), source, () => openPath(source))));
    lesson = lessons.find(({ done, steps }) => done > 0 && done < steps) ?? lessons.find(({ done }) => done === 0);
    const done = lessons.filter(({ done, steps }) => done === steps).length;
    const minutes = lessons.map((each) => each.minutes);
    const all = `${lessons.length} lessons of ${Math.min(...minutes)} to ${Math.max(...minutes)} minutes: predict, run, see.`;
    at("next-lesson").textContent = lesson
      ? `${done ? `${done} of ${lessons.length} lessons done.` : all} Next: ${lesson.title}.`
      : "All lessons are done.";
    at("continue").textContent = lesson?.done ? "Continue" : "Begin";
    at("continue").hidden = !lesson;
  }

  function openPath(source) {
    at("path").value = source;
    ask(at("path-fault"), { do: "open_source", source });
  }

  at("repair").addEventListener("click", () => command({ do: "repair_recordings" }));
  at("home").addEventListener("click", () => show(!open));
  at("back").addEventListener("click", close);
  at("demo").addEventListener("click", ({ target }) =>
    ask(target.parentElement.querySelector(".fault"), { do: "open_source", source: "sim:city" }),
  );
  at("open").addEventListener("submit", (event) => {
    event.preventDefault();
    openPath(at("path").value.trim());
  });
  at("all-lessons").addEventListener("click", () => {
    modes.set("learn");
    close();
  });
  at("continue").addEventListener("click", ({ target }) => {
    ask(target.parentElement.querySelector(".fault"), { do: "learn", name: lesson.name }, () => modes.set("learn") ?? true);
  });
  addEventListener("keydown", ({ key, target }) => {
    if (key === "Escape" && open && state?.phase === "ready" && !document.querySelector("dialog[open]") && !target.value) close();
  });
  browser(at("browse"), at("folders"), at("path-fault"), openPath);
  return { heard, follow, close, open: () => show(true) };
}

// The folder browser: what can be opened, and folders to look into.
function browser(button, place, fault, openPath) {
  async function look(path) {
    const answer = await fetch(`folders?${new URLSearchParams({ in: path })}`);
    if (!answer.ok) {
      fault.textContent = await answer.text();
      return;
    }
    const { path: here, above, entries } = await answer.json();
    const list = element("ul");
    if (above) list.append(entry("..", "folder above", () => look(above)));
    for (const { name, path, source } of entries) {
      list.append(
        source ? entry(`▶ ${name}`, `opens ${name}`, () => openPath(path)) : entry(`${name}/`, `looks into ${name}`, () => look(path)),
      );
    }
    if (!entries.length) list.append(element("li", "quiet", "Nothing here can be opened."));
    place.replaceChildren(element("p", "quiet", here), list);
  }
  button.addEventListener("click", () => {
    place.hidden = !place.hidden;
    button.setAttribute("aria-expanded", String(!place.hidden));
    if (!place.hidden) look("");
  });
}

function entry(text, hint, press) {
  const made = element("li");
  made.append(link(text, hint, press));
  return made;
}

function link(text, hint, press) {
  const made = element("button", "link", text);
  Object.assign(made, { type: "button", title: hint });
  made.addEventListener("click", press);
  return made;
}

// Of a path its last two parts.
const nameOf = (source) => (source.includes("://") ? source : source.split("/").slice(-2).join("/"));
