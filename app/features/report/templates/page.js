// Draws the figures that the page carries: when they come into view, in the colours of the page's theme; all of them
// before the page is printed, in the colours and width of paper.
"use strict";
const figures = JSON.parse(document.getElementById("figures").textContent);
const dark = matchMedia("(prefers-color-scheme: dark)");
const PAPER = {
  width: 660, // px: within A4 and letter, upright, at 96 px an inch
  colours: { "--line": "#d9dde1", "--text": "#1c2126", "--card": "#ffffff", "--quiet": "#5b656e" },
};
let printing = false;

async function loadPlotly() {
  const packed = Uint8Array.from(atob(document.getElementById("plotly").textContent.trim()), (c) => c.charCodeAt(0));
  const plain = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
  const script = document.createElement("script");
  script.textContent = await new Response(plain).text();
  document.head.append(script);
}

const colour = (name) => printing ? PAPER.colours[name] : getComputedStyle(document.documentElement).getPropertyValue(name).trim();

function axis(own) {
  const title = { text: own.title, standoff: 8, font: { size: 12 } };
  return { gridcolor: colour("--line"), zerolinecolor: colour("--line"), linecolor: colour("--line"), automargin: true, ...own, ...(own.minor && { minor: { ...own.minor, gridcolor: colour("--line") } }), title };
}

function layout(own) {
  const found = {
    ...own, paper_bgcolor: "transparent", plot_bgcolor: "transparent", hovermode: "closest",
    ...(printing ? { autosize: false, width: PAPER.width } : { autosize: true }),
    font: { color: colour("--text"), size: 12, family: "system-ui, sans-serif" },
    margin: { l: 60, r: 14, t: own.annotations ? 42 : 14, b: 46 },
    legend: { orientation: "h", y: -0.22, yanchor: "top", itemsizing: "constant" },
    hoverlabel: { bgcolor: colour("--card"), bordercolor: colour("--line"), font: { color: colour("--text") } },
    modebar: { bgcolor: "transparent", color: colour("--quiet"), activecolor: colour("--text") },
  };
  for (const key of Object.keys(own)) if (/^[xy]axis\d*$/.test(key)) found[key] = axis(own[key]);
  if (own.scene) {
    found.margin = { l: 0, r: 0, t: 0, b: 0 };
    found.legend.y = 0;
    found.scene = { ...own.scene, bgcolor: "transparent" };
    for (const key of ["xaxis", "yaxis", "zaxis"]) {
      found.scene[key] = { ...own.scene[key], title: { text: own.scene[key].title }, gridcolor: colour("--line"), zerolinecolor: colour("--line"), backgroundcolor: "transparent" };
    }
  }
  return found;
}

const config = { responsive: true, displaylogo: false, scrollZoom: true, modeBarButtonsToRemove: ["select2d", "lasso2d"] };

function draw(place) {
  const { traces, layout: own } = figures[Number(place.dataset.figure)];
  place.dataset.drawn = "yes";
  return Plotly.react(place, traces, layout(own), config);
}

async function start() {
  await loadPlotly();
  const watcher = new IntersectionObserver((entries) => {
    for (const entry of entries) {
      if (entry.isIntersecting) {
        watcher.unobserve(entry.target);
        draw(entry.target);
      }
    }
  }, { rootMargin: "400px" });
  const places = [...document.querySelectorAll("[data-figure]")];
  places.forEach((place) => watcher.observe(place));
  const again = () => places.filter((place) => place.dataset.drawn).forEach(draw);
  dark.addEventListener("change", again);
  addEventListener("beforeprint", () => {
    printing = true;
    places.filter((place) => !place.closest("details:not([open])")).forEach(draw);
  });
  addEventListener("afterprint", () => {
    printing = false;
    again();
  });
}

const ready = start().catch((error) => {
  const told = document.getElementById("trouble");
  told.textContent = `The plots cannot be drawn in this browser (${error.message}); a browser of 2023 or later can. The tables hold the numbers.`;
  told.hidden = false;
});
