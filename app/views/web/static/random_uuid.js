// Browsers withhold crypto.randomUUID from pages that came over plain HTTP from another machine (`--host`, or a published page
// there); Rerun's WebViewer names its channels by it. Where it is missing, random bytes in the same form.
crypto.randomUUID ??= () => {
  const bytes = crypto.getRandomValues(new Uint8Array(16));
  bytes[6] = (bytes[6] & 15) | 64;
  bytes[8] = (bytes[8] & 63) | 128;
  const text = Array.from(bytes, (byte) => byte.toString(16).padStart(2, "0")).join("");
  return [0, 8, 12, 16, 20].map((at, i, all) => text.slice(at, all[i + 1])).join("-");
};
