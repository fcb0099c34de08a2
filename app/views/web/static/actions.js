// What keys and buttons stand for: the server lists each action with the command that it sends (app/session/actions.py).
let known = {};

export function setActions(keys) {
  known = Object.fromEntries(keys.map((action) => [action.name, action.command]));
}

// The command of an action; before the first message of the server, one that does nothing.
export function action(name) {
  return known[name] ?? { do: name };
}
