// The check that was clicked, over time, in the time axis' own scale: a click into it seeks as one into the axis does.
const box = document.getElementById("plot");
const part = (name) => box.querySelector(name);

export function makePlot(command) {
  let name = "";
  part("button").addEventListener("pointerdown", (event) => event.stopPropagation());
  part("button").addEventListener("click", () => command({ do: "plot", name }));

  return (plot) => {
    box.hidden = !plot;
    if (!plot) return;
    name = plot.name;
    part("b").textContent = name;
    for (const text of ["help", "now", "high", "low", "beyond"]) part(`.${text}`).textContent = plot[text];
    part(".help").title = plot.help;
    part(".values").setAttribute("d", plot.values);
    part(".values").style.stroke = plot.colour;
    part(".threshold").setAttribute("d", plot.thresholds);
  };
}
