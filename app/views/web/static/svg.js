// Elements of SVG pictures.
const SVG = "http://www.w3.org/2000/svg";

export function made(tag, attributes) {
  const element = document.createElementNS(SVG, tag);
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
  return element;
}
