// "Save this view": the numbers behind it, as files that the browser keeps where it keeps downloads.
const dialog = document.getElementById("save");

export function openSaving() {
  document.getElementById("saving").addEventListener("click", () => dialog.showModal());
  dialog.addEventListener("click", ({ target }) => (target.closest("a") || target === dialog) && dialog.close());
}
