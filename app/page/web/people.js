// Several people at one session: one drives, the others follow, or look around at exposures of their own. The server
// decides who drives (app/page/people.py); where a page looks on its own, only the page knows.
const place = document.getElementById("people");
const STEPS = { forward: 1, back: -1 };

// `send` gives a command to the server, `tell` shows a sentence, `moved` is called when this page shows another exposure.
export function makePeople(send, tell, moved) {
  let state = null; // the session's
  let own = null; // the exposure that this page looks at; null while it follows
  const drives = () => !state || state.people.driving || (state.people.driver === null && state.people.may_drive);

  function lookAt(index) {
    own = index === null ? null : Math.min(Math.max(index, 0), state.computed - 1);
    paint(state.people);
    moved();
  }

  // What one who does not drive asks for: they can look elsewhere, all else is the driver's.
  function lookAround(message) {
    const now = own ?? state.index;
    if (message.do === "seek") lookAt(message.index);
    else if (message.do in STEPS) lookAt(now + STEPS[message.do]);
    else if (message.do === "start") lookAt(0);
    else if (message.do === "end") lookAt(state.computed - 1);
    else tell(`${driver(state.people)} drives this session${state.people.may_drive ? "; take over to change it" : ""}. You can look at any exposure.`);
  }

  function paint(people) {
    const { driving, others, you, may_drive } = people;
    const mine = driving ? "You drive" : `${driver(people)} drives, you ${own === null ? "follow" : `look at exposure ${own}`}`;
    const words = document.createElement("span");
    words.textContent = `${mine} · ${others.length === 1 ? "1 other" : `${others.length} others`} here`;
    words.title = `You are person ${you}. One person drives a session; the others see the same, or look at other exposures.`;
    const buttons = [];
    if (!driving && own !== null) buttons.push(button("Follow", () => lookAt(null)));
    if (!driving && may_drive) buttons.push(button("Take over", () => send({ do: "take_over" })));
    for (const other of driving ? others.filter((each) => each.may_drive) : []) {
      buttons.push(button(`Hand over to person ${other.number}`, () => send({ do: "hand_over", to: other.number })));
    }
    place.replaceChildren(...(driving && !others.length ? [] : [words, ...buttons]));
  }

  return {
    drives,
    command: (message) => (drives() ? send(message) : lookAround(message)),
    // The session's new state as this page shows it; `times` are those of the exposures [ms].
    shown: (next, times) => {
      const before = state;
      state = next;
      if (before && before.people.driving !== next.people.driving) {
        tell(next.people.driving ? "You drive now." : `${driver(next.people)} drives now.`);
      }
      if (before?.run !== next.run || next.people.driving) own = null;
      if (JSON.stringify(before?.people) !== JSON.stringify(next.people)) paint(next.people);
      return own === null ? next : { ...next, index: own, time_s: (times[own] ?? 0) / 1000, playing: false };
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
