// "Save this view" of a published page: the CSV files that the server makes, from a table that was published with the run.

// `table` loads it, `name` gives what a file is called, `index` the frame that is shown; `tell` shows a sentence.
export function offerNumbers(table, name, index, tell) {
  for (const link of document.querySelectorAll("#save a[href^='numbers/']")) {
    link.addEventListener("click", async (event) => {
      event.preventDefault();
      const isRun = link.href.endsWith("run");
      try {
        const found = await table();
        keep(csv(isRun ? overTime(found) : ofFrame(found, index())), `${name(isRun)}.csv`);
      } catch (fault) {
        tell(`The numbers cannot be loaded (${fault.message}).`);
      }
    });
  }
}

const overTime = ({ quantities, rows }) => [quantities.map(([quantity]) => quantity), ...rows];

const ofFrame = ({ quantities, rows }, index) => [
  ["quantity", "value", "unit", "meaning"],
  ...quantities.map(([quantity, unit, meaning], i) => [quantity, rows[index][i], unit, meaning]).filter(([, value]) => value !== ""),
];

const csv = (rows) => rows.map((row) => `${row.map(quoted).join()}\n`).join("");
const quoted = (cell) => (/[",\n\r]/.test(cell) ? `"${cell.replaceAll('"', '""')}"` : cell);

function keep(text, name) {
  const href = URL.createObjectURL(new Blob([text], { type: "text/csv" }));
  Object.assign(document.createElement("a"), { href, download: name }).click();
  setTimeout(() => URL.revokeObjectURL(href), 60_000);
}
