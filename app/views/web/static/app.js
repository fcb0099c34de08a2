// The page: talks to the session, shows its state, and keeps the two viewers on the same frame.
import { action } from "./actions.js";
import { makeAddress } from "./address.js";
import { makeCaptions } from "./captions.js";
import { makeAxis } from "./time_axis.js";
import { makeCompare } from "./compare.js";
import { openControls } from "./controls.js";
import { listen, setKeys } from "./keyboard.js";
import { makeLesson } from "./lesson.js";
import { showNotice, showNotices } from "./notices.js";
import { makeModes } from "./modes.js";
import { openPanes } from "./panes.js";
import { makePeople } from "./people.js";
import { offerNumbers } from "./published_numbers.js";
import { openPublishedView } from "./published_view.js";
import { openPublished } from "./published_session.js";
import { published, site } from "./published.js";
import { makeQuestion } from "./question.js";
import { openViewer } from "./rerun.js";
import { openSaving } from "./save_view.js";
import { makeSplitter } from "./splitter.js";
import { makeStart } from "./start.js";
import { openSocket } from "./session_link.js";
import { showImages, showOffline, showState, showViewer } from "./status_bar.js";
import { makeTransport } from "./transport.js";

history.replaceState(null, "", location.pathname + location.hash); // the token is the cookie's now, and nobody's to copy

const dark = matchMedia("(prefers-color-scheme: dark)"); // styles and the Rerun viewer follow it by themselves
dark.addEventListener("change", () => {
  controls?.paint(dark.matches);
  axis.draw();
});

const at = (id) => document.getElementById(id);
let state = null;
let taught = null; // the lesson, as the server sent it last
const pane = { tab: "" };
const link = (published ? openPublished : openSocket)({ opened, heard, streamed: (data) => viewer.streamed(data), lost: showOffline });
const send = (message) => link.send(message);
const people = makePeople(
  send,
  command,
  () => axis.data,
  (text) => showNotice({ text, kind: "info" }),
);
const viewer = openViewer(send, (message) => people.command(message), showViewer);

function paneBecame(change) {
  if (Object.entries(change).every(([key, value]) => pane[key] === value)) return;
  send({ do: "pane", ...Object.assign(pane, change) });
}
makeSplitter();

function opened() {
  send({ do: "pane", ...pane });
  viewer.connected();
}

function heard(next) {
  state = next;
  if (state.keys) setKeys(state.keys);
  if (state.lesson !== undefined) lesson.news((taught = state.lesson));
  window.ispom = { state, viewer, send: people.command, action, axis: axis.data, lesson: taught };
  show(state);
  showNotices(start.heard(state));
}

// The session's state, at the frame that this page looks at.
function show(state) {
  const shown = people.shown(state);
  window.ispom.shown = shown;
  showState(shown);
  axis.show(shown);
  showImages(axis.data.kinds, shown.index);
  showTransport(shown);
  viewer.follow(shown);
  address.follow(shown);
  controls?.follow(!people.drives());
  panes.follow(!people.drives());
  panes.show(shown);
  panes.offer("Lesson", taught ? [taught.name, taught.place, taught.phase].join() : "");
  publishedView?.show(shown);
  ask(shown.question, people.drives());
  lesson.follow(people.drives(), state.people);
  start.follow(shown);
  modes.follow(shown, taught);
  compare.follow(shown);
  cover();
  if (!published) showCaptions(shown);
}

// What lies over the run, which has its keys back when that is closed.
function cover() {
  const sheet = document.querySelector(".sheet:not([hidden])");
  document.body.dataset.sheet = sheet?.id ?? "";
  for (const id of ["answer", "panes", "dock"]) document.getElementById(id).inert = Boolean(sheet);
}

function fileName() {
  const { address, index } = window.ispom.shown;
  return `${address.run.replace(/[^A-Za-z0-9._-]+/g, "-")}-${index}`;
}

function command(message) {
  address.release();
  people.command(message);
}

// What a key asks for. Of a source that is still being opened there is nothing to move in yet; later it would come as a surprise.
function press(message) {
  if (state?.phase !== "opening") command(message);
  else showNotice({ text: `${state.source} is still being opened: keys work once it is.`, kind: "info" });
}
const showCaptions = makeCaptions(); // before the keys, which let nobody hear of those that they take
listen(window, press);
const controls = published ? null : openControls(dark.matches, press, command, (tab) => openTab({ viser: tab }));
const publishedView = published ? openPublishedView(command) : null;
const tabs = { own: "", viser: "" };
const panes = openPanes(
  command,
  publishedView ? { View: publishedView.page } : { Controls: at("controls").parentElement },
  (own) => openTab({ own }),
  published && !site ? {} : { Lesson: at("lesson") },
);

// Which of viser's tabs can be seen, for what nobody sees is not drawn.
function openTab(change) {
  Object.assign(tabs, change);
  paneBecame({ tab: tabs.own === "Controls" ? tabs.viser : "" });
}

const again = () => state && show(state);
const modes = makeModes(command, link.answer, () => {
  start.close();
  again();
});
const start = makeStart(command, modes, again);
const compare = makeCompare(command, link.answer, modes, start.open);
const address = makeAddress(people.command, people.drives, modes);
const showTransport = makeTransport(press);
const ask = makeQuestion(send);
const lesson = makeLesson(send, command);
openSaving(fileName, viewer, (text) => showNotice({ text, kind: "info" }));
if (published) {
  const run = () => fileName().replace(/-\d+$/, "");
  offerNumbers(
    () => link.answer("numbers"),
    (isRun) => (isRun ? run() : fileName()),
    () => window.ispom.shown.index,
    (text) => showNotice({ text, kind: "error" }),
  );
}
const axis = makeAxis((index) => command({ do: "seek", index }), command);

link.open();
