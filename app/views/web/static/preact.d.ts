// What the page uses of preact.js.
export type Child = VNode | VNode[] | string | number | boolean | null | undefined;
export interface VNode {
  readonly type: unknown;
}
export type Html = (strings: TemplateStringsArray, ...values: unknown[]) => VNode;
export const html: Html;
export function render(node: Child, place: Element): void;
