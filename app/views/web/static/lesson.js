// A lesson: its step's text and question, one's own answer, and, when it is revealed, what the run showed. Everybody
// answers for themselves; whoever drives leads through the steps.
import { element } from "./element.js";
import { draw } from "./lesson_curve.js";
import { point } from "./lesson_picture.js";

const place = document.getElementById("lesson");
const PHASES = { preparing: "The step is being set up …", running: "Running …" };
const KINDS = { choose, number, point, draw };

// `send` gives an answer to the server, `command` what whoever drives asks for.
export function makeLesson(send, command) {
  let lesson = null;
  let drives = true;
  let question = null; // shows the latest answers: ({ yours, truth, chosen, open }) => void
  let built = "";

  function news(next) {
    lesson = next;
    place.hidden = !lesson;
    document.body.classList.toggle("covered", Boolean(lesson?.covers));
    if (!lesson) built = "";
    else paint();
  }

  function paint() {
    const { name, phase, place: at } = lesson;
    const key = [name, at, phase].join();
    if (built !== key) {
      built = key;
      build();
    }
    question({ ...lesson, open: lesson.phase === "asking" });
    place.querySelector(".count").textContent = counted(lesson);
    const reveal = place.querySelector(".reveal");
    if (reveal) reveal.textContent = lesson.yours === null ? "Reveal without an answer" : "Run and reveal";
  }

  function build() {
    const { title, place: at, steps, about, heading, before, after, doubt, phase, ask, verdict } = lesson;
    const answer = (given) => send({ do: "answer", given });
    const asked = element("div", "question");
    question = KINDS[ask.kind](asked, ask, answer);
    place.replaceChildren(
      row(
        element("b", "", title),
        element("span", "quiet", `${at + 1} of ${steps}`),
        act("✕", "end the lesson", { do: "end_lesson" }, "sign"),
      ),
      Object.assign(element("div", "text"), { innerHTML: `${about}<h2>${escaped(heading)}</h2>${before}` }),
      asked,
      element("p", "count quiet"),
      ...(verdict === null || phase !== "revealed"
        ? []
        : [
            element(
              "p",
              verdict ? "verdict right" : "verdict wrong",
              verdict ? "Your answer is right." : "Your answer is not what the run shows.",
            ),
          ]),
      ...(after === null ? [] : [Object.assign(element("div", "text after"), { innerHTML: after })]),
      ...(doubt ? [element("p", "verdict wrong", doubt)] : []),
      moves(),
    );
    if (after === null) place.scrollTop = 0;
    else requestAnimationFrame(() => place.querySelector(".verdict, .after")?.scrollIntoView()); // the plots are back then
  }

  function moves() {
    const { place: at, steps, phase } = lesson;
    const back = act("Back", "the step before", { do: "turn_to", place: at - 1 });
    back.disabled = at === 0;
    const last = at === steps - 1;
    const on = {
      asking: act("", "runs what the question is about, and shows the answer", { do: "reveal" }, "reveal main"),
      revealed: last
        ? act("Finish", "back to the page without a lesson", { do: "end_lesson" }, "main")
        : act("Next", "the next step", { do: "turn_to", place: at + 1 }, "main"),
    }[phase];
    return row(element("span", "quiet leads"), back, on ?? element("span", "quiet", PHASES[phase]));
  }

  function act(text, hint, message, kind = "") {
    const made = Object.assign(element("button", `${kind} act`, text), { title: hint, ariaLabel: kind === "sign" ? hint : null });
    made.onclick = () => command(message);
    return made;
  }

  return {
    news,
    follow: (now, people) => {
      drives = now;
      place.classList.toggle("follows", !drives);
      const leads = place.querySelector(".leads");
      const words = drives ? "" : `Person ${people.driver ?? "?"} leads through the lesson.`;
      if (leads && leads.textContent !== words) leads.textContent = words;
    },
  };
}

function choose(into, { options }, answer) {
  const buttons = options.map((text, i) => {
    const made = element("button", "option", text);
    made.append(element("span", "chose quiet"));
    made.onclick = () => answer(i);
    return made;
  });
  into.append(...buttons);
  return ({ yours, truth, chosen, answered, open }) => {
    for (const [i, button] of buttons.entries()) {
      button.ariaPressed = String(yours === i);
      button.disabled = !open;
      button.classList.toggle("right", Boolean(truth?.includes(i)));
      button.lastElementChild.textContent = truth && answered > 1 ? `${chosen[i] ?? 0} of ${answered}` : "";
    }
  };
}

function number(into, { unit }, answer) {
  const field = Object.assign(document.createElement("input"), { type: "number", step: "any", ariaLabel: "your answer" });
  field.oninput = () => field.value !== "" && answer(Number(field.value));
  const found = element("b", "found");
  into.append(field, ` ${unit} `, found);
  return ({ yours, truth, open }) => {
    if (document.activeElement !== field && yours !== null) field.value = yours;
    field.disabled = !open;
    found.textContent = truth === null ? "" : `the run: ${Number(truth.toPrecision(4))} ${unit}`;
  };
}

function counted({ answered, right, phase }) {
  if (phase === "revealed" && answered > 1) return `${right} of ${answered} answers are right.`;
  return answered > 1 ? `${answered} people have answered.` : "";
}

function row(...parts) {
  const made = element("div", "row");
  made.append(...parts);
  return made;
}

const escaped = (text) => element("i", "", text).innerHTML;
