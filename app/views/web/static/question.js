// The question before a run is closed with branches that nothing else keeps: whoever drives answers it, wherever the command came from.
const dialog = document.getElementById("question");
const [no, yes] = ["question-no", "question-yes"].map((id) => document.getElementById(id));

// `send` gives the answer to the server.
export function makeQuestion(send) {
  let asked = null; // the question in the dialog
  let answered = 0; // number of the last one that was answered here
  const answer = (wanted) => {
    if (!asked || asked.number === answered) return;
    answered = asked.number;
    send({ do: "confirm", number: asked.number, yes: wanted });
    dialog.close();
  };
  no.addEventListener("click", () => answer(false));
  yes.addEventListener("click", () => answer(true));
  dialog.addEventListener("close", () => dialog.open || answer(false)); // by Escape; browsers need not ask about that
  return (question, drives) => {
    const wanted = question && drives && question.number !== answered ? question : null;
    if (wanted?.number === asked?.number && dialog.open === Boolean(wanted)) return;
    if (wanted && wanted.number === asked?.number) return answer(false); // just closed by Escape: its event comes later
    asked = wanted;
    if (dialog.open) dialog.close();
    if (!wanted) return;
    document.getElementById("question-text").textContent = wanted.text;
    yes.textContent = wanted.yes;
    dialog.showModal();
  };
}
