// Debug | Compare | Learn: what the page is laid out for. Each page has its own mode; the session knows nothing of it.
import { element } from "./element.js";
import { published, runs, site } from "./published.js";

const MODES = site ? ["debug", "learn"] : published ? ["debug", "compare"].slice(0, runs) : ["debug", "compare", "learn"];
const buttons = [...document.querySelectorAll("#modes input")];
const list = document.getElementById("learn");

// `command` asks the session for something, `answer` gives what it knows, `changed` is called after a person, or the address, chose another mode.
export function makeModes(command, answer, changed) {
  const modes = { mode: "debug", usual: site ? "learn" : "debug", set, follow };
  let lessons = null; // as the server sent them
  let asked = ""; // the progress that they were fetched for

  if (site === "failures") buttons.at(-1).nextSibling.textContent = "Gallery";
  for (const button of buttons) button.addEventListener("change", () => set(button.value));

  function set(mode) {
    const known = MODES.includes(mode) ? mode : "debug";
    const before = modes.mode;
    modes.mode = known;
    document.body.dataset.mode = known;
    for (const button of buttons) button.checked = button.value === known;
    if (before !== known) changed();
  }

  // Without a run there is nothing to debug or compare. In Learn the list of lessons is shown until one is on.
  function follow(state, lesson) {
    for (const button of buttons) button.disabled = button.value !== "learn" && ["empty", "failed"].includes(state.phase);
    const shown = modes.mode === "learn" && !lesson && !document.body.dataset.home;
    list.hidden = !shown;
    const key = JSON.stringify([state.address.lesson, state.run]);
    if (!shown || (asked === key && lessons)) return;
    asked = key;
    answer("runs").then((found) => {
      if (found) paint((lessons = found.lessons));
      else asked = "";
    });
  }

  function paint(found) {
    if (site === "failures") return paintFailures(found);
    const done = found.filter(({ done, steps }) => done === steps).length;
    const head = element("div", "head");
    const count = done ? `${done} of ${found.length} done.` : found.length > 1 ? `${found.length} lessons.` : "";
    const runs = site
      ? "Their runs were computed when this page was made."
      : "A lesson opens simulated recordings; your run stays in the table of runs.";
    head.append(element("h1", "", "Lessons"), element("span", "quiet", `${count} Predict, run, see. ${runs}`));
    const cards = element("ol", "lessons");
    cards.append(...found.map(card));
    list.replaceChildren(head, cards);
  }

  function paintFailures(found) {
    const head = element("div", "head");
    const runs = "Simulated runs with one fault each, and what the doctor finds in them.";
    head.append(element("h1", "", "Ways to fail"), element("span", "quiet", runs));
    const cards = element("ol", "lessons");
    cards.append(...found.map(failure));
    list.replaceChildren(head, cards);
  }

  function failure({ name, title, about, answer, command: shell }, i) {
    const made = element("li");
    const button = made.appendChild(element("button", "lesson-card"));
    button.dataset.run = name;
    button.addEventListener("click", () => {
      command({ do: "open_named", name });
      set("debug");
    });
    button.append(element("span", "quiet", `${i + 1}`), element("b", "", title), element("span"));
    button.append(element("span", "about", about), element("span", "about", `The doctor: ${answer}.`));
    button.append(element("code", "about quiet", shell));
    return made;
  }

  function card({ name, title, minutes, steps, done }, i) {
    const made = element("li");
    const button = made.appendChild(element("button", "lesson-card"));
    button.dataset.learn = name;
    button.addEventListener("click", () => command({ do: "learn", name }));
    button.append(element("span", "quiet", `${i + 1}`), element("b", "", title));
    const state = done === steps ? "done" : done ? `${done} of ${steps} steps` : `${minutes} min`;
    const bar = Object.assign(document.createElement("progress"), { max: steps, value: done, ariaLabel: `${done} of ${steps} steps done` });
    button.append(element("span", "quiet", state), bar);
    return made;
  }

  return modes;
}
