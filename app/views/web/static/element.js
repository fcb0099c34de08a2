// @ts-check
/**
 * An element with its classes and its text.
 * @type {<K extends keyof HTMLElementTagNameMap>(tag: K, kind?: string, text?: string) => HTMLElementTagNameMap[K]}
 */
export const element = (tag, kind = "", text = "") => Object.assign(document.createElement(tag), { className: kind, textContent: text });
