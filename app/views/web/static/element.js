// An element with its classes and its text.
export const element = (tag, kind = "", text = "") => Object.assign(document.createElement(tag), { className: kind, textContent: text });
