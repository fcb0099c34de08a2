// Several people at one session: one drives, the others follow, or look around at a place of their own. The server decides who
// drives (app/session/people.py).
import { action } from "./actions.js";
import { makePlace, moves } from "./place.js";
import { published } from "./published.js";

const line = document.getElementById("people");

// `send` gives a command to the server, `command` one that a hand asked for, `axis` is what is known of the run, `tell` shows a
// sentence.
export function makePeople(send, command, axis, tell) {
  let state = null; // the session's
  const place = makePlace({
    facts: () => factsOf(axis(), state),
    shared: () => state,
    changed: (own) => send({ do: "look_at", ...own }),
  });
  let taking = false; // whether it has asked to be in control, and was not heard yet
  // Of a published run, every page has its own place.
  const movesAlone = (message) => state && message.do in moves && (published || !(drives() || taking));
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
    if (!driving && looking !== null) buttons.push(button(`Follow ${driver(people)}`, () => command({ do: "follow" })));
    if (!driving && may_drive) buttons.push(button("Take over", () => command({ do: "take_control" })));
    for (const other of driving ? others.filter((each) => each.may_drive) : []) {
      buttons.push(button(`Hand over to person ${other.number}`, () => send({ do: "take_control", to: other.number })));
    }
    line.replaceChildren(...(driving && !others.length ? [] : [words, ...buttons]));
  }

  let painted = "";
  return {
    drives,
    command: (message) => {
      if (message.do === "follow") place.leave();
      taking ||= message.do === "take_control" && message.to === undefined;
      if (!movesAlone(message)) return send(message);
      const reason = place.obey(message);
      if (reason) tell(reason);
    },
    // The session's new state as this page shows it.
    shown: (next) => {
      const before = state;
      state = next;
      taking &&= !next.people.driving && next.people.may_drive;
      if (before && (before.run !== next.run || next.people.driving > before.people.driving)) place.leave();
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

function factsOf({ times, kinds, methods, events, marks, computed }, { playing, target }) {
  return {
    times,
    kinds,
    keyFrames: methods.flatMap(({ keyFrames }) => keyFrames),
    events: [...events, ...(marks.bookmarks?.marks ?? []).map(({ at }) => ({ at, severity: "" }))],
    computed,
    goesOn: !published && (playing || target !== null),
  };
}

const driver = ({ driver: number }) => (number === null ? "Nobody" : `Person ${number}`);

function button(text, press) {
  const made = document.createElement("button");
  made.textContent = text;
  made.onclick = press;
  return made;
}
