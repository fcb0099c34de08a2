// The question before a run is closed with branches that nothing else keeps: whoever drives answers it, wherever the command came from.
const dialog = document.getElementById("question");
const [no, yes] = ["question-no", "question-yes"].map((id) => document.getElementById(id));

// `send` gives the answer to the server, whose next state closes the dialog.
export function makeQuestion(send) {
  let asked = null;
  const answer = (wanted) => asked && send({ do: "confirm", number: asked.number, yes: wanted });
  no.addEventListener("click", () => answer(false));
  yes.addEventListener("click", () => answer(true));
  dialog.addEventListener("cancel", (event) => {
    event.preventDefault();
    answer(false);
  });
  return (question, drives) => {
    if (question?.number === asked?.number && dialog.open === Boolean(question && drives)) return;
    asked = question;
    if (dialog.open) dialog.close();
    if (!question || !drives) return;
    document.getElementById("question-text").textContent = question.text;
    yes.textContent = question.yes;
    dialog.showModal();
  };
}
