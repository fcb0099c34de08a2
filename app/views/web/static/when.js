// A time as people say it: "today 14:02", "yesterday 9:30", "Tuesday", "3 Nov 2026".
const DAY_S = 86_400;

// Both in seconds since 1970; the day begins at midnight where the reader is.
export function whenText(time, now) {
  const [then, today] = [new Date(time * 1000), new Date(now * 1000)];
  const clock = then.toLocaleTimeString("en-GB", { hour: "2-digit", minute: "2-digit" });
  const midnight = new Date(today.getFullYear(), today.getMonth(), today.getDate()).getTime() / 1000;
  if (time >= midnight + DAY_S) return then.toLocaleDateString("en-GB", { day: "numeric", month: "short", year: "numeric" });
  if (time >= midnight) return `today ${clock}`;
  if (time >= midnight - DAY_S) return `yesterday ${clock}`;
  if (time >= midnight - 6 * DAY_S) return then.toLocaleDateString("en-GB", { weekday: "long" });
  return then.toLocaleDateString("en-GB", { day: "numeric", month: "short", year: "numeric" });
}
