// What each method looks like, in every chart of every page.
import { mark, symbol } from "./theme.js";

// Methods that have a look of their own, in order; each declares its place in its class.
const KNOWN = (document.documentElement.dataset.methods ?? "").split(" ");

// So many pairs of a colour and a shape differ; plugins share those that are left.
const PAIRS = 24;

export function looksOf(method) {
  const place = KNOWN.indexOf(method);
  const position = place >= 0 ? place : KNOWN.length + (sumOf(method) % (PAIRS - KNOWN.length));
  return { symbol: symbol(position), itemStyle: { color: mark(position) } };
}

// Of its name alone: what else a page shows changes nothing.
function sumOf(name) {
  return [...name].reduce((sum, letter) => (31 * sum + letter.codePointAt(0)) % 1_000_003, 0);
}
