// The lessons of a published page: what their service would tell it, from messages that were recorded when the lessons were
// published (app/features/publish/gallery/lessons.py). Answers are judged here.
import { load } from "./published.js";

const KEPT = "ispom.lessons"; // what was done, in this browser

// `enter` shows a run at a frame, with these layers hidden, and is awaited; `again` tells the page what there is now.
export function makePublishedLessons(enter, again) {
  let now = null; // { lesson, steps, place, yours, open, shown } of the lesson that is on; `shown` are the branches of answers
  let serial = 0; // of what was asked for last
  const done = kept();

  async function learn({ name, place = null }, { listed }) {
    const lesson = listed.find((each) => each.name === name);
    if (!lesson) return `there is no lesson “${name.slice(0, 60)}”: choose one of the list`;
    const own = serial;
    const { steps } = await load(`lesson-${name}`);
    if (own !== serial) return ""; // something else was asked for meanwhile
    const next = done[name] ?? 0;
    return turn({ lesson, steps, shown: [] }, place ?? (next < steps.length ? next : 0));
  }

  async function turn(before, place) {
    const step = before.steps[place];
    if (!step) return `${before.lesson.title} has ${before.steps.length} steps: there is no step ${place + 1}`;
    await change({ ...before, place, yours: null, open: true }, step.at);
  }

  // Where the run cannot be had, all stays as it is.
  async function change(next, index) {
    const before = now;
    now = next;
    try {
      await enter(next.steps[next.place].run, index, hidden());
    } catch (fault) {
      if (now === next) now = before;
      throw fault;
    }
  }

  async function reveal() {
    const { lesson, steps, place, shown } = now;
    const step = steps[place];
    const branches = step.branches.map((name) => `${step.run} ${name}`);
    done[lesson.name] = Math.max(done[lesson.name] ?? 0, place + 1);
    keep(done);
    await change({ ...now, open: false, shown: [...new Set([...shown, ...branches])] }, step.to ?? Infinity);
  }

  // Layers and branches that are not drawn: of branches those whose question was not answered yet.
  function hidden() {
    const { steps, place, open, shown } = now;
    const { run, hidden: layers } = steps[place];
    const branches = steps.filter((each) => each.run === run).flatMap((each) => each.branches);
    return [...(open ? layers : []), ...branches.filter((name) => !shown.includes(`${run} ${name}`))];
  }

  const commands = {
    learn,
    turn_to: ({ place }) => now && turn(now, place),
    reveal: () => now?.open && reveal(),
    answer: ({ given }) => {
      if (now?.open) Object.assign(now, { yours: given });
      return again();
    },
    end_lesson: () => {
      now = null;
      return enter(null, null, []);
    },
  };

  return {
    commands: new Set(Object.keys(commands)),
    // Does what is asked for, and returns a sentence where it cannot.
    async obey(message, site) {
      const own = ++serial;
      const refused = await commands[message.do](message, site);
      return own === serial ? refused : "";
    },
    get steps() {
      return done;
    },
    // What the page shows otherwise than the run: `limit` frames are known, and `covered` is in place of its numbers.
    get view() {
      if (!now) return { lesson: null, address: "", limit: Infinity, covered: null };
      const { lesson, steps, place, yours, open } = now;
      const step = steps[place];
      const { asking, revealed, covered, at, to } = step;
      const verdict = open || yours === null ? null : isRight(step, yours);
      return {
        lesson: { ...(open ? asking : revealed), yours, answered: Number(yours !== null), right: null, verdict, chosen: {} },
        address: `${lesson.name}:${place + 1}`,
        limit: (open ? at : (to ?? Infinity)) + 1,
        covered: open ? covered : null,
      };
    },
  };
}

function isRight({ revealed: { truth, ask }, within }, yours) {
  if (ask.kind === "number") return Math.abs(yours - truth) <= within;
  if (ask.kind !== "draw") return truth.includes(yours);
  const [low, high] = ask.y_range;
  const off = yours.map((height, i) => Math.abs(height - Math.min(Math.max(truth[i], low), high)));
  return off.reduce((sum, each) => sum + each, 0) / off.length <= within;
}

// A browser may forbid to keep anything.
function kept() {
  try {
    return JSON.parse(localStorage.getItem(KEPT) ?? "{}");
  } catch {
    return {};
  }
}

function keep(done) {
  try {
    localStorage.setItem(KEPT, JSON.stringify(done));
  } catch {
    // forgotten when the page is closed
  }
}
