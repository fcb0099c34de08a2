// The list of versions below the menu, and a note on pages that are not of the latest one. ../versions.js, which docs/versions.py
// writes beside the folders of all versions, sets ISPOM_VERSIONS; a site that was built alone has no such file, and no list.
(() => {
  const place = document.getElementById("versions");
  const versions = window.ISPOM_VERSIONS;
  if (!place || !versions) return;
  const { home, version } = place.dataset;

  function link(folder, text) {
    const found = document.createElement("a");
    found.href = `${home}/${folder}/index.html`;
    found.textContent = text;
    return found;
  }

  const title = document.createElement("p");
  title.textContent = "Versions";
  const list = document.createElement("ul");
  for (const name of versions.all) {
    const item = document.createElement("li");
    item.append(name === versions.latest ? link("latest", `${name} (latest)`) : link(name, name));
    if (name === version) item.firstChild.setAttribute("aria-current", "true");
    list.append(item);
  }
  place.append(title, list);
  place.hidden = false;

  const article = document.getElementById("furo-main-content");
  if (!article || version === versions.latest) return;
  const note = document.createElement("p");
  note.className = "old-version";
  note.setAttribute("role", "note");
  note.append(`This page is of version ${version}. The latest is `, link("latest", versions.latest), ".");
  article.prepend(note);
})();
