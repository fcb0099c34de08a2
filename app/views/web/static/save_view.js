// "Save this view": the numbers behind it, and a picture of it, as files that the browser keeps where it keeps downloads.
import { pictureOf } from "./picture.js";

const dialog = document.getElementById("save");
const button = document.getElementById("saving");

// `name` gives what the file is called, `viewer` the picture of its canvas; `tell` shows a sentence.
export function openSaving(name, viewer, tell) {
  const picture = document.getElementById("picture");
  button.addEventListener("click", () => dialog.showModal());
  dialog.addEventListener("click", ({ target }) => (target.closest("a, button") || target === dialog) && dialog.close());
  picture.addEventListener("click", async () => {
    dialog.close(); // before the picture is taken
    button.disabled = true;
    try {
      const drawn = await viewer.picture();
      const canvas = await pictureOf(document, new Map([[document.querySelector("#canvas canvas"), drawn]]));
      keep(await new Promise((done) => canvas.toBlob(done)), `${name()}.png`);
      if (!drawn) tell("The Rerun viewer drew nothing: its place in the picture is empty.");
    } catch (fault) {
      tell(`This browser gives no picture of the page (${fault.message}): take a screenshot instead.`);
    }
    button.disabled = false;
  });
}

function keep(blob, name) {
  const link = Object.assign(document.createElement("a"), { href: URL.createObjectURL(blob), download: name });
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 60_000);
}
