// The list of the keys: a dialog that "?" and the bar's button open, and Escape or a click closes.
const dialog = document.getElementById("keys");
const SIGNS = { ArrowLeft: "←", ArrowRight: "→" };

export function listKeys(keys) {
  const own = [
    { key: "f", label: "Frame the path", hint: "The 3-D view shows all of it, and goes with it." },
    { key: "?", label: "List of the keys", hint: "This list; Escape closes it." },
  ];
  dialog.querySelector("tbody").replaceChildren(...[...keys, ...own].map(row));
}

export function toggleKeys() {
  if (dialog.open) dialog.close();
  else dialog.showModal();
  return true;
}

// Whether there was anything to hide.
export function hideKeys() {
  const open = dialog.open;
  dialog.close();
  return open;
}

document.getElementById("help").addEventListener("click", toggleKeys);
dialog.addEventListener("click", ({ target }) => target.closest("table") || dialog.close());

function row({ key, label, hint }) {
  const made = document.createElement("tr");
  const keys = made.insertCell();
  for (const part of key.split("+")) keys.append(Object.assign(document.createElement("kbd"), { textContent: SIGNS[part] ?? part }));
  made.insertCell().textContent = label;
  made.insertCell().textContent = hint;
  return made;
}
