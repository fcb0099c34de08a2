// The runs table: everything that was run or recorded. A click opens a run; two that are selected can be compared.
import { element } from "./element.js";
import { locatedTexts } from "./located.js";
import { made as drawn } from "./svg.js";
import { whenText } from "./when.js";

const KINDS = {
  All: () => true,
  Live: (kind) => kind === "live",
  Sweeps: (kind) => kind === "sweep" || kind === "experiment",
  Recordings: (kind) => kind === "run" || kind === "recording",
};
const AGAIN_MS = 3000; // another process may finish a run at any time
const at = (id) => document.getElementById(id);

// `ask` asks for what takes another run, `close` goes back to the one that is shown, `compared` to a comparison.
export function makeRuns(command, ask, close, compared) {
  const table = at("runs");
  const fault = at("runs-fault");
  const selected = new Set(); // keys, at most two
  const opened = new Set(); // keys of the groups whose runs are listed
  let found = null; // as the server sent it
  let painted = "";
  let kind = "All";
  let due = null;
  let shown = false;
  let notify = () => {};

  for (const name of Object.keys(KINDS)) {
    const button = at("kinds").appendChild(element("button", "button", name));
    button.type = "button";
    button.ariaPressed = String(name === kind);
    button.addEventListener("click", () => {
      kind = name;
      for (const each of at("kinds").children) each.ariaPressed = String(each === button);
      paint();
    });
  }
  at("filter").addEventListener("input", () => paint());
  at("compare-selected").addEventListener("click", compare);

  async function load() {
    clearTimeout(due);
    due = setTimeout(() => shown && load(), AGAIN_MS);
    if (document.visibilityState !== "visible") return;
    const text = await fetch("runs").then(
      (answer) => (answer.ok ? answer.text() : null),
      () => null,
    );
    if (!text || text === painted || table.contains(document.activeElement?.closest("input.note"))) return;
    painted = text;
    found = JSON.parse(text);
    paint();
    notify(found);
  }

  let of = "";
  function follow(now, state, tell) {
    notify = tell;
    const key = JSON.stringify([state.branches, state.run, state.recording === null]);
    const fresh = now && (!shown || of !== key);
    [shown, of] = [now, key];
    if (fresh) load();
  }

  function paint() {
    if (!found) return;
    const focus = table.contains(document.activeElement) ? document.activeElement.dataset.focus : null;
    const rows = visible();
    for (const key of selected) if (!found.rows.some((row) => row.key === key)) selected.delete(key);
    const made = [head(), element("tbody")];
    made[1].append(...rows.map(tableRow));
    if (!rows.length) made[1].append(empty());
    if (found.omitted) made[1].append(wide(`${found.omitted} older runs are not listed.`));
    if (
      !patched(
        [...table.rows],
        made.flatMap((part) => [...part.rows]),
      )
    )
      table.replaceChildren(...made);
    if (focus && !table.contains(document.activeElement)) table.querySelector(`[data-focus="${CSS.escape(focus)}"]`)?.focus();
    choose();
  }

  // A row that matches brings the run that it was forked from, so that its indent means something.
  function visible() {
    const words = at("filter").value.toLowerCase().split(/\s+/).filter(Boolean);
    const byKey = new Map(found.rows.map((row) => [row.key, row]));
    const text = ({ source, name, differs, note }) => [source, name, ...differs, note].join(" ").toLowerCase();
    const isWanted = (row) => KINDS[kind](byKey.get(row.parent)?.kind ?? row.kind, row) && words.every((word) => text(row).includes(word));
    const folded = ({ parent }) => ["sweep", "experiment"].includes(byKey.get(parent)?.kind) && !opened.has(parent) && !words.length;
    return found.rows.filter((row) => isWanted(row) && !folded(row));
  }

  const empty = () => wide(found.rows.length ? "No run matches." : "No runs yet: play the demo, or open a recording.");

  function wide(text) {
    const row = element("tr");
    row.append(Object.assign(element("td", "quiet", text), { colSpan: 10 + found.columns.length }));
    return row;
  }

  function head() {
    const row = element("tr");
    const names = ["", "", "Source", "Run", "Differs in"];
    row.append(...names.map((name) => heading(name)));
    for (const { label, alignment } of found.columns) {
      const cell = heading(label, "number");
      cell.append(element("span", "", `ATE${alignment ? `, ${alignment}` : ""}`));
      row.append(cell);
    }
    row.append(heading("Error"), heading("Localised", "number"), heading("Events"), heading("When"), heading("Note"));
    const made = element("thead");
    made.append(row);
    return made;
  }

  function heading(text, kind = "") {
    const made = Object.assign(element("th", kind, text), { scope: "col" });
    if (!text) made.replaceChildren(element("span", "unseen", "Choose, image"));
    return made;
  }

  function tableRow(row) {
    const made = element("tr", selected.has(row.key) ? "selected" : "");
    made.dataset.key = row.key;
    made.append(chooser(row), picture(row), element("td", "source", row.source || "–"), name(row), differs(row));
    for (const cells of row.ate) made.append(ates(cells));
    made.append(
      sparks(row),
      located(row),
      events(row),
      element("td", "quiet", row.when === null ? "live" : whenText(row.when, Date.now() / 1000)),
      note(row),
    );
    made.addEventListener(
      "click",
      ({ target }) => target.closest("input, button, a") || open(found.rows.find(({ key }) => key === row.key)),
    );
    return made;
  }

  function chooser(row) {
    const cell = element("td");
    if (isGroup(row)) return cell;
    const box = cell.appendChild(document.createElement("input"));
    Object.assign(box, { type: "checkbox", checked: selected.has(row.key), ariaLabel: `Select ${row.name} to compare` });
    box.dataset.focus = `select ${row.key}`;
    box.addEventListener("change", () => {
      if (!box.checked) selected.delete(row.key);
      else {
        if (selected.size === 2) selected.delete([...selected][0]); // the one that was chosen first
        selected.add(row.key);
      }
      paint();
    });
    return cell;
  }

  function picture(row) {
    const cell = element("td", "picture");
    if (row.picture) cell.append(Object.assign(document.createElement("img"), { src: row.picture, alt: "", loading: "lazy" }));
    return cell;
  }

  function name(row) {
    const cell = element("td", "run");
    cell.style.setProperty("--depth", row.depth);
    const group = isGroup(row);
    const button = cell.appendChild(element("button", "link", row.name));
    Object.assign(button, { type: "button", title: group ? "Lists its runs" : row.shown ? "Back to this run" : "Opens this run" });
    if (group) button.setAttribute("aria-expanded", String(opened.has(row.key)));
    button.dataset.focus = `open ${row.key}`;
    button.addEventListener("click", () => open(row));
    if (row.shown) cell.append(element("span", "pill", "on the stage"));
    if (row.recording) {
      const link = cell.appendChild(element("a", "pill", "recording"));
      Object.assign(link, { href: row.recording, download: "", title: `Downloads the Rerun recording (${row.size} on disk)` });
    }
    return cell;
  }

  function differs({ differs, kind, parent }) {
    const texts = differs.length ? differs : kind === "recording" ? [] : [kind === "live" && parent ? "nothing" : "defaults"];
    const cell = element("td", differs.length ? "differs" : "differs quiet", texts.slice(0, 2).join("; "));
    if (texts.length > 2) cell.append(` and ${texts.length - 2} more`);
    cell.title = texts.join("\n");
    return cell;
  }

  function ates(cells) {
    const made = element("td", "number");
    for (const { variant, text, alignment, best } of cells) {
      const line = made.appendChild(element("div", best ? "best" : ""));
      if (best) line.title = "The smallest of the runs on this source";
      if (variant) line.append(element("span", "quiet", `${variant} `));
      line.append(text);
      if (alignment) line.append(element("span", "quiet", ` ${alignment}`));
    }
    if (!cells.length) made.append(element("span", "quiet", "–"));
    return made;
  }

  // The position error over the frames, a line for each method, on a logarithmic scale.
  function sparks({ curves }) {
    const cell = element("td", "sparks");
    if (!curves.length) return cell;
    const logs = curves.map(({ values }) => values.map((value) => Math.log(Math.max(value, 1e-4))));
    const [low, high] = [Math.min(...logs.flat()), Math.max(...logs.flat())];
    const svg = cell.appendChild(drawn("svg", { viewBox: "0 0 80 30", preserveAspectRatio: "none", "aria-hidden": "true" }));
    logs.forEach((line, i) => {
      const x = (place) => ((80 * place) / Math.max(line.length - 1, 1)).toFixed(1);
      const y = (value) => (28 - (26 * (value - low)) / (high - low || 1)).toFixed(1);
      svg.append(drawn("polyline", { points: line.map((value, place) => `${x(place)},${y(value)}`).join(" "), stroke: curves[i].colour }));
    });
    const names = curves.map(({ label }) => label).join(", ");
    cell.title = `Position error over the frames, logarithmic: ${names}`;
    return cell;
  }

  function located(row) {
    const cell = element("td", "number");
    const lines = locatedTexts(row);
    cell.append(...lines.map((text) => element("div", "", text)));
    if (row.located.some(([, share]) => share < 0.75)) cell.classList.add("alarm");
    cell.title = `Share of the method's frames at which it tracked${isGroup(row) ? ", in the run with the fewest" : ""}`;
    return cell;
  }

  function events({ events, worst, events_by }) {
    const cell = element("td", worst, events === null ? "–" : events ? `● ${events}` : "0");
    if (events) cell.append(` ${worst === "lost" ? "lost" : events === 1 ? "warning" : "warnings"}`);
    cell.title = Object.entries(events_by)
      .map(([severity, count]) => `${severity}: ${count}`)
      .join("\n");
    return cell;
  }

  function note(row) {
    const cell = element("td");
    if (row.note === null) return cell;
    const field = cell.appendChild(element("input", "note"));
    Object.assign(field, { value: row.note, maxLength: 200, ariaLabel: `Note on ${row.name}`, placeholder: "add a note" });
    field.dataset.focus = `note ${row.key}`;
    field.addEventListener("change", () => command({ do: "put_note", name: row.key, note: field.value }));
    field.addEventListener("keydown", ({ key }) => key === "Enter" && field.blur());
    return cell;
  }

  function open(row) {
    if (isGroup(row)) {
      if (!opened.delete(row.key)) opened.add(row.key);
      paint();
    } else if (row.shown) close();
    else if (/^live:\d+\.\d+$/.test(row.key)) ask(fault, { do: "show_kept", key: row.key });
    else if (row.key.startsWith("live:")) ask(fault, { do: "show_branch", number: Number(row.key.slice(5)) });
    else ask(fault, { do: "open_named", name: row.key });
  }

  function choose() {
    const button = at("compare-selected");
    button.disabled = selected.size !== 2;
    button.title = selected.size === 2 ? "" : "Select two runs in the table";
  }

  // Runs on one source share a stage; of others, what differs is listed here.
  async function compare() {
    const pair = [...selected].map((chosen) => found.rows.find(({ key }) => key === chosen)); // A was selected first
    const [a, b] = pair;
    at("differences").hidden = true;
    if (a.source === b.source)
      return ask(fault, { do: "compare_runs", a: a.key, b: b.key }, (state) => {
        if (state.compared !== null) compared();
        return state.compared !== null;
      });
    const answer = await fetch(`differences?${new URLSearchParams({ a: a.key, b: b.key })}`);
    if (answer.ok) listDifferences(pair, await answer.json());
    else fault.textContent = `${a.name} and ${b.name} are on different sources. ${await answer.text()}`;
  }

  function listDifferences([a, b], { settings, first, methods }) {
    const place = at("differences");
    const lines = settings.slice(0, 12).map(({ name, a, b }) => element("li", "", `${name}: ${a} | ${b}`));
    const list = element("ul");
    list.append(...lines);
    if (settings.length > lines.length) list.append(element("li", "quiet", `and ${settings.length - lines.length} more`));
    const words = !methods.length
      ? "They have no method in common."
      : first === null
        ? "All frames agree."
        : `First difference: frame ${first.frame}. ${first.lines.join("; ")}.`;
    place.replaceChildren(
      element("h2", "", `${a.name} and ${b.name}`),
      element("p", "", `They are on different sources, so that they share no stage. ${words}`),
      list,
    );
    place.hidden = false;
  }

  return { follow };
}

// Brings rows to what new ones show, cell by cell, so that what is pointed at or pressed stays; false where they are other rows.
function patched(old, rows) {
  const keys = (each) => JSON.stringify(each.map(({ dataset, cells }) => [dataset.key, cells.length]));
  if (keys(old) !== keys(rows)) return false;
  rows.forEach((row, i) => {
    old[i].className = row.className;
    [...row.cells].forEach((cell, j) => {
      const [before, box] = [old[i].cells[j], cell.querySelector("[type=checkbox]")];
      if (before.outerHTML !== cell.outerHTML) before.replaceWith(cell);
      else if (box) before.firstElementChild.checked = box.checked;
    });
  });
  return true;
}

const isGroup = ({ kind }) => kind === "sweep" || kind === "experiment";
