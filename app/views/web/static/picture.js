// The page as a picture: HTML inside an SVG, with its styles as they are now, and what scripts drew (canvases) or other
// documents hold (frames) as pictures in their places. Nothing leaves the browser, and nobody is asked for a permission.
const NOT_XML = /[^\t\n\r\u0020-\uD7FF\uE000-\uFFFD\u{10000}-\u{10FFFF}]/gu;
const SVG = "http://www.w3.org/2000/svg";

// A canvas with a document as it stands in its window. `canvases`: by canvas, a copy of what it shows where that cannot be
// read at any time.
export async function pictureOf(page, canvases) {
  const { innerWidth: width, innerHeight: height, devicePixelRatio: scale } = page.defaultView;
  const drawn = await image(await asSvg(page, canvases, width, height));
  const canvas = Object.assign(document.createElement("canvas"), { width: width * scale, height: height * scale });
  canvas.getContext("2d").drawImage(drawn, 0, 0, canvas.width, canvas.height);
  return canvas;
}

async function asSvg(page, canvases, width, height) {
  const root = page.documentElement;
  const copy = root.cloneNode(true);
  const copies = [...copy.querySelectorAll("*")];
  for (const [i, own] of [...root.querySelectorAll("*")].entries()) await stand(own, copies[i], canvases);
  for (const gone of copy.querySelectorAll("script, style, link, noscript")) gone.remove();
  const style = page.createElement("style");
  style.textContent = [...page.styleSheets].map((sheet) => rules(sheet.cssRules, page.defaultView)).join("\n");
  copy.prepend(style);
  const svg = page.createElementNS(SVG, "svg");
  for (const { name, value } of root.attributes) svg.setAttribute(name, value); // :root is this one here
  svg.setAttribute("width", width);
  svg.setAttribute("height", height);
  const { colorScheme, fontSize } = page.defaultView.getComputedStyle(root);
  Object.assign(svg.style, { colorScheme, fontSize }); // of which 1rem is made
  copy.style.fontSize = fontSize;
  const place = svg.appendChild(page.createElementNS(SVG, "foreignObject"));
  place.setAttribute("width", "100%");
  place.setAttribute("height", "100%");
  place.append(copy);
  return new XMLSerializer().serializeToString(svg).replace(NOT_XML, "");
}

// What a copy of an element does not have by itself.
async function stand(own, copy, canvases) {
  const kind = own.localName;
  if (kind === "canvas") replace(own, copy, canvases.get(own) ?? own);
  else if (kind === "iframe" && own.contentDocument?.body) replace(own, copy, await pictureOf(own.contentDocument, canvases));
  else if (kind === "img" && own.naturalWidth && !own.src.startsWith("data:")) replace(own, copy, painted(own));
  else if (kind === "input" || kind === "textarea") {
    if (kind === "textarea") copy.textContent = own.value;
    copy.setAttribute("value", own.value);
    copy.toggleAttribute("checked", Boolean(own.checked));
  } else if (kind === "select") copy.options[own.selectedIndex]?.setAttribute("selected", "");
  if (own.scrollTop && copy.firstElementChild) copy.firstElementChild.style.marginTop = `${-own.scrollTop}px`;
}

function replace(own, copy, canvas) {
  const { width, height } = own.getBoundingClientRect();
  const picture = own.ownerDocument.createElement("img");
  for (const { name, value } of own.attributes) if (!["src", "width", "height"].includes(name)) picture.setAttribute(name, value);
  if (canvas.width && canvas.height) picture.src = canvas.toDataURL();
  Object.assign(picture.style, { width: `${width}px`, height: `${height}px` });
  copy.replaceWith(picture);
}

function painted(picture) {
  const canvas = Object.assign(document.createElement("canvas"), { width: picture.naturalWidth, height: picture.naturalHeight });
  canvas.getContext("2d").drawImage(picture, 0, 0);
  return canvas;
}

// As text, with the conditions on the screen decided here: a picture has no screen.
function rules(found, view) {
  const text = (rule) => {
    if (!rule.media) return rule.cssText;
    return view.matchMedia(rule.media.mediaText).matches ? rules(rule.cssRules, view) : "";
  };
  return [...found].map(text).join("\n");
}

async function image(svg) {
  const found = new Image();
  found.src = `data:image/svg+xml;charset=utf-8,${encodeURIComponent(svg)}`;
  await found.decode();
  return found;
}
