// What the commands that only look mean in a published run: the fields of the state that take new values, or a sentence that
// says why there is nothing to do. Moves come as the place that they lead to (place.js).
const MOST_PLOTS = 12;
const ONLY_FIRST = "This page has the comparisons of its first run with each of the others: choose the first one as A.";

export const branchLayer = (number) => `branch:${number}`;
export const isBranch = (layer) => layer.startsWith(branchLayer(""));

export const commandsOf = {
  look_at: ({ do: _, ...place }) => place,
  // Branches are no layers that a person hides: they come with the answers of a lesson.
  hide: ({ names }, { hidden = [] }, data) => ({ hidden: [...names.filter((name) => data.paths[name]), ...hidden.filter(isBranch)] }),
  plot: ({ name }, { plots }, data) => {
    if (plots.includes(name)) return { plots: plots.filter((each) => each !== name) };
    if (!data.plots.rows[name]) return `“${name.slice(0, 60)}” is no quantity of this run: choose a check, or one of the list`;
    return { plots: [...plots, name].slice(-MOST_PLOTS) };
  },
  set_plots: ({ names }, _, data) => ({ plots: (names ?? data.plots.usual).filter((name) => data.plots.rows[name]).slice(0, MOST_PLOTS) }),
  compare_runs: ({ a, b }, { compared }, { comparisons }) => {
    const found = comparisons.find(({ branches, numbers }) => branches[numbers[0]] === a && branches[numbers[1]] === b);
    return found ? { compared: [found.numbers[0], found.numbers[1], ...compared.slice(2)] } : ONLY_FIRST;
  },
  open_named: ({ name }, { source }) => (name === source ? {} : `this page has the run ${source}, and no other`),
};
