// Whether this page is one that `ispom publish` wrote: a folder of files, without a server. Then its data is in this folder.
export const published = document.documentElement.dataset.published ?? "";
export const runs = Number(document.documentElement.dataset.runs ?? 0); // the number of its runs that are compared
export const site = document.documentElement.dataset.site ?? ""; // what it lists, where it has many pages in one: "lessons"

// The bytes of a compressed file of the folder, as a stream. A server may have unpacked it already: then it is as it comes.
// `count` is called with the bytes that have come, and the bytes of the whole file (0 where that is unknown).
export async function unpacked(url, count = () => {}) {
  const response = await fetch(url);
  if (!response.ok) throw new Error(`${url.split("/").at(-1)} is not there (${response.status}): publish the run again`);
  const total = Number(response.headers.get("Content-Length"));
  let loaded = 0;
  const counter = new TransformStream({
    transform(chunk, out) {
      count((loaded += chunk.byteLength), total);
      out.enqueue(chunk);
    },
  });
  const [look, stream] = response.body.pipeThrough(counter).tee();
  const reader = look.getReader();
  const { value } = await reader.read();
  reader.cancel();
  const isPacked = value?.[0] === 0x1f && value[1] === 0x8b; // gzip's first bytes
  return isPacked ? stream.pipeThrough(new DecompressionStream("gzip")) : stream;
}

// Of a file of the folder, without its ending, the address.
export const addressOf = (name) => `${published}/${name}.bin`;

// A value of a file of the folder.
export const load = async (name) => new Response(await unpacked(addressOf(name))).json();
