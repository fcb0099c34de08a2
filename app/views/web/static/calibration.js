// The calibration page: asks, shows how far it is, and then images, points, residuals and maps of each camera.
import { keepFocus } from "./focus.js";

const POLL_MS = 400;
const by = (id) => document.getElementById(id);
const SVG = "http://www.w3.org/2000/svg";
const form = by("ask");
let state = null;
let camera = 0;
let view = 0;
let seen = null;

async function poll() {
  try {
    const answer = await fetch(`calibration/state?known=${encodeURIComponent(state?.known ?? "")}`);
    if (answer.status === 200) show(await answer.json());
  } catch {
    by("doing").textContent = "The app does not answer.";
  }
  setTimeout(poll, POLL_MS);
}

function show(next) {
  const another = next.number !== state?.number;
  if (next.asked && (!state || another)) fill(next.asked);
  state = next;
  if (another) [camera, view] = [0, 0];
  by("doing").textContent = next.doing ? `${next.doing} …` : "";
  by("fault").textContent = next.fault;
  form.querySelector("[type=submit]").disabled = by("simulate").disabled = Boolean(next.doing);
  const verdict = by("verdict");
  verdict.textContent = next.verdict?.level ?? "";
  verdict.dataset.level = next.verdict?.level ?? "";
  by("said").replaceChildren(
    ...list("Why", next.verdict?.reasons),
    ...list("What to film next", next.verdict?.advice),
    ...list("Result", next.facts),
    ...list("Beside its truth", next.truth),
    ...stored(next),
  );
  showCamera();
}

function list(title, lines) {
  if (!lines?.length) return [];
  const [head, body] = [document.createElement("h2"), document.createElement("ul")];
  head.textContent = title;
  for (const line of lines) body.appendChild(document.createElement("li")).textContent = line;
  return [head, body];
}

// What was kept, this one first, each with its files.
function stored(next) {
  const [head, body] = [document.createElement("h2"), document.createElement("ul")];
  head.textContent = "Stored calibrations";
  body.className = "stored";
  for (const each of next.stored) {
    const line = body.appendChild(document.createElement("li"));
    if (each.name === next.kept) line.className = "new";
    line.append(`${each.name}: ${each.level}, ${each.what} `);
    for (const file of each.files) {
      const link = line.appendChild(document.createElement("a"));
      link.href = `calibration/kept/${encodeURIComponent(each.name)}/${file}`;
      link.textContent = file;
      if (file.endsWith(".html")) link.target = "_blank";
      else link.download = file;
      line.append(" ");
    }
  }
  return next.stored.length ? [head, body] : [];
}

function showCamera() {
  const tabs = state.cameras.map((each, i) => {
    const tab = document.createElement("button");
    tab.textContent = each.name;
    tab.role = "tab";
    tab.dataset.camera = i;
    tab.ariaSelected = String(i === camera);
    tab.onclick = () => {
      camera = i;
      view = 0;
      showCamera();
    };
    return tab;
  });
  by("cameras").replaceChildren(...tabs);
  const each = state.cameras[camera];
  const most = Math.max(...(each?.views ?? []).map((v) => v.rms_px ?? 0), 1e-9);
  const bars = (each?.views ?? []).map((v, i) => {
    const bar = document.createElement("button");
    bar.role = "option";
    bar.dataset.view = i;
    bar.className = v.reason ? "lost" : "";
    bar.style.height = `${Math.max(12, 100 * ((v.rms_px ?? most) / most))}%`;
    bar.title = bar.ariaLabel = `${v.name}: ${v.reason || (v.rms_px == null ? `${v.points} points` : `${v.rms_px.toFixed(3)} px`)}`;
    bar.onclick = () => {
      view = i;
      showView();
    };
    return bar;
  });
  by("views").replaceChildren(...bars);
  const cards = (each?.drawings ?? []).map(([title, svg]) => {
    const card = document.createElement("div");
    card.appendChild(document.createElement("h2")).textContent = title;
    card.insertAdjacentHTML("beforeend", svg);
    return card;
  });
  const parameters = each?.parameters ? [card("Parameters, with their standard errors", each)] : [];
  by("drawings").replaceChildren(...parameters, ...cards);
  showView();
}

function card(title, each) {
  const found = document.createElement("div");
  found.append(...list(title, each.parameters), ...list("Model and images", [each.model, each.used]));
  return found;
}

async function showView() {
  const each = state.cameras[camera];
  by("empty").hidden = Boolean(each);
  by("image").hidden = !each;
  by("scale").hidden = !each?.drawings;
  [...by("views").children].forEach((bar, i) => (bar.ariaSelected = String(i === view)));
  if (!each) {
    seen = null;
    by("about").textContent = "";
    by("overlay").replaceChildren();
    return;
  }
  const where = `camera=${each.name}&view=${view}&number=${state.number}`;
  by("image").src = `calibration/image?${where}`;
  const answer = await fetch(`calibration/seen?${where}`);
  if (!answer.ok || state.cameras[camera] !== each) return;
  seen = await answer.json();
  const it = each.views[view];
  const error = it.rms_px == null ? "" : `, reprojection error ${it.rms_px.toFixed(3)} px`;
  by("about").textContent = `${it.name}: ${it.points} points${error}${seen.reason ? `; not used: ${seen.reason}` : ""}`;
  draw();
}

function draw() {
  const each = state?.cameras[camera];
  if (!seen || !each) return;
  const overlay = by("overlay");
  const factor = Number(by("scale").querySelector("input").value);
  by("scale").querySelector("output").textContent = `${factor} times as long`;
  overlay.setAttribute("viewBox", `-0.5 -0.5 ${each.size[0]} ${each.size[1]}`);
  const radius = each.size[0] / 200;
  const circles = [...seen.used.map(([u, v]) => [u, v, ""]), ...seen.others.map(([u, v]) => [u, v, "lost"])];
  const shapes = circles.map(([u, v, name]) => shape("circle", { cx: u, cy: v, r: radius, class: name }));
  const path = seen.used.map(([u, v, du, dv]) => `M${u} ${v}l${factor * du} ${factor * dv}`).join("");
  overlay.replaceChildren(...shapes, shape("path", { d: path }));
}

function shape(kind, values) {
  const made = document.createElementNS(SVG, kind);
  for (const [name, value] of Object.entries(values)) made.setAttribute(name, value);
  return made;
}

function fill(asked) {
  form.elements.what.value = asked.what;
  form.elements.images.value = asked.images.join("\n");
  form.elements.target.value = asked.target;
}

async function start() {
  const { what, images, target } = form.elements;
  const asked = new URLSearchParams({ what: what.value, images: images.value, target: target.value });
  const answer = await fetch(`calibration/start?${asked}`, { method: "POST" });
  by("fault").textContent = answer.ok ? "" : await answer.text();
}

form.onsubmit = (event) => {
  event.preventDefault();
  start();
};
by("simulate").onclick = () => {
  fill({
    what: form.elements.what.value,
    images: ["sim:calibration?views=20"],
    target: form.elements.target.value || "aprilgrid:6x6:0.03:0.3",
  });
  start();
};
by("scale").querySelector("input").oninput = draw;
keepFocus(document);
poll();
window.calibration = {
  get state() {
    return state;
  },
  get view() {
    return [camera, view];
  },
};
