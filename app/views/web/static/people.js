// Several people at one session: one drives, the others follow, or look around at frames of their own. The server
// decides who drives (app/session/people.py), and what a page that looks around shows (app/views/web/looking.py).
import { action } from "./actions.js";

const place = document.getElementById("people");

// `send` gives a command to the server, `command` one that a hand asked for, `tell` shows a sentence.
export function makePeople(send, command, tell) {
  let state = null; // the session's
  const drives = () => !state || state.people.driving || (state.people.driver === null && state.people.may_drive);

  const words = document.createElement("span");

  function say({ people, looking }, { index }) {
    const { driving, others, you } = people;
    const away = looking !== index ? `, the tab Controls shows ${index}` : "";
    const mine = driving
      ? "You are in control"
      : `${driver(people)} is in control, you ${looking === null ? "follow" : `look at frame ${looking}${away}`}`;
    words.textContent = `${mine} · ${others.length === 1 ? "1 other" : `${others.length} others`} here`;
    words.title = `You are person ${you}. One person is in control of a session; the others see the same, or look around by themselves: with the keys, the time axis, and the buttons here.`;
  }

  function paint({ people, looking, playing }) {
    const { driving, others, may_drive } = people;
    const buttons = [];
    if (!driving) {
      const moves = { back: "◀ Step", play: playing ? "‖ Pause" : "▶ Play", forward: "Step ▶" };
      buttons.push(...Object.entries(moves).map(([name, text]) => button(text, () => command(action(name)))));
    }
    if (!driving && looking !== null) buttons.push(button(`Follow ${driver(people)}`, () => send({ do: "follow" })));
    if (!driving && may_drive) buttons.push(button("Take over", () => send({ do: "take_control" })));
    for (const other of driving ? others.filter((each) => each.may_drive) : []) {
      buttons.push(button(`Hand over to person ${other.number}`, () => send({ do: "take_control", to: other.number })));
    }
    place.replaceChildren(...(driving && !others.length ? [] : [words, ...buttons]));
  }

  let painted = "";
  return {
    drives,
    command: send,
    // The session's new state as this page shows it.
    shown: (next) => {
      const before = state;
      state = next;
      if (before && before.people.driving !== next.people.driving) {
        tell(next.people.driving ? "You are in control now." : `${driver(next.people)} is in control now.`);
      }
      if (before && next.refused[0] > before.refused[0]) tell(next.refused[1]);
      const shown = next.own === null ? next : { ...next, ...next.own };
      say(shown, next);
      const wanted = JSON.stringify([next.people, next.looking === null, shown.playing]);
      if (painted !== wanted) paint(shown); // not at each frame: a button that is drawn again while it is pressed is not clicked
      painted = wanted;
      return shown;
    },
  };
}

const driver = ({ driver: number }) => (number === null ? "Nobody" : `Person ${number}`);

function button(text, press) {
  const made = document.createElement("button");
  made.textContent = text;
  made.onclick = press;
  return made;
}
