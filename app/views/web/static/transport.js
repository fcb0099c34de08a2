// The controls of time: play and step, speed, loop, bookmark. Each button does what its key does.
import { action } from "./actions.js";

const SPEEDS = [
  [null, "as fast as possible"],
  [4, "4 ×"],
  [2, "2 ×"],
  [1, "1 ×"],
  [0.5, "0.5 ×"],
  [0.2, "0.2 ×"],
];
const at = (id) => document.getElementById(id);

// `command` sends what a person asks for.
export function makeTransport(command) {
  for (const button of at("transport").querySelectorAll("button[data-do]")) {
    button.addEventListener("click", () => command(action(button.dataset.do)));
  }
  const speed = at("speed");
  speed.replaceChildren(...SPEEDS.map(([factor, text]) => new Option(text, String(factor))));
  speed.addEventListener("change", () => {
    command({ do: "speed", factor: speed.value === "null" ? null : Number(speed.value) });
    speed.blur(); // its keys are the run's again
  });
  const add = at("add-plot");
  add.addEventListener("change", () => {
    const name = add.value.trim();
    if (name) command({ do: "plot", name });
    add.value = "";
    add.blur();
  });

  return (state) => {
    const play = at("play");
    const text = state.playing ? "Pause" : "Play";
    if (play.getAttribute("aria-label") !== text) {
      play.setAttribute("aria-label", text);
      play.textContent = state.playing ? "❚❚" : "▶";
      play.title = `${text} (Space)`;
    }
    if (document.activeElement !== speed) speed.value = String(state.speed);
    const loop = state.loop ? `${state.loop[0]}–${state.loop[1] ?? "end"}` : "";
    if (at("loop").textContent !== loop) at("loop").textContent = loop;
    at("no-loop").hidden = !state.loop;
  };
}
