// Notices: what a person must be told once. They go by themselves, errors later; one that was there before this page was
// opened is not news.
const INFO_MS = 6_000;
const ERROR_MS = 20_000;
const MOST = 3;
const list = document.getElementById("notices");
let newest = null; // number of the last notice that this page has heard of

export function showNotices(notices) {
  const before = newest ?? Infinity;
  newest = notices.at(-1)?.number ?? newest ?? 0;
  for (const notice of notices) if (notice.number > before) showNotice(notice);
}

// What is said again while it is there is not there twice.
export function showNotice({ text, kind }) {
  for (const shown of [...list.children]) if (shown.firstElementChild.textContent === text) shown.remove();
  const item = document.createElement("div");
  item.className = `notice ${kind}`;
  item.setAttribute("role", kind === "error" ? "alert" : "status");
  const words = document.createElement("span");
  words.textContent = text;
  const close = document.createElement("button");
  close.textContent = "✕";
  close.ariaLabel = "dismiss";
  close.onclick = () => item.remove();
  item.append(words, close);
  list.append(item);
  // Not while it is being read.
  const leave = () => (item.matches(":hover, :focus-within") ? setTimeout(leave, 1000) : item.remove());
  setTimeout(leave, kind === "error" ? ERROR_MS : INFO_MS);
  while (list.children.length > MOST) list.firstElementChild.remove();
}
