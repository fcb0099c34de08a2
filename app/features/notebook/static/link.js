// The link between a page of view.js and Python, see view.py. It draws the page only where it was given one.

function render({ model, el }) {
  const channel = new BroadcastChannel(model.get("channel"));
  let hearing = false; // Whether a change comes from the page.
  const tell = () => {
    if (!hearing) channel.postMessage({ state: { frame: model.get("frame"), tracks: model.get("tracks") } });
  };
  const news = (message) => channel.postMessage({ news: message });

  channel.onmessage = ({ data }) => {
    if (data.hello) {
      model.send({ known: data.hello });
      tell();
    }
    if (data.chosen) {
      hearing = true;
      model.set("frame", data.chosen.frame);
      model.set("tracks", data.chosen.tracks);
      hearing = false;
      model.save_changes();
    }
  };
  model.on("change:frame", tell);
  model.on("change:tracks", tell);
  model.on("msg:custom", news);

  channel.postMessage({ hail: true }); // The page may have begun before.

  const page = model.get("page");
  if (page) {
    const frame = document.createElement("iframe");
    frame.srcdoc = page;
    frame.title = "A run";
    frame.style = "width: 100%; height: 560px; border: 0";
    el.append(frame);
  }
  return () => {
    channel.close();
    model.off("change:frame", tell);
    model.off("change:tracks", tell);
    model.off("msg:custom", news);
  };
}

export default { render };
