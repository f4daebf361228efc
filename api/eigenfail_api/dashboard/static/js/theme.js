// Colours of the style sheet, for what is drawn on a canvas.
export const SYMBOLS = ["circle", "rect", "triangle", "diamond", "pin", "roundRect"];
export const DASHES = ["solid", "dashed", "dotted", [8, 3, 2, 3], [2, 2], [12, 4], [5, 2, 1, 2, 1, 2], [1, 4]];
const MARKS = 8;

export function colour(name) {
  return getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
}

export function mark(position) {
  return colour(`mark-${position % MARKS}`);
}

export function symbol(position) {
  return SYMBOLS[position % SYMBOLS.length];
}

export function dash(position) {
  return DASHES[position % DASHES.length];
}

export function onThemeChange(listener) {
  window.matchMedia("(prefers-color-scheme: dark)").addEventListener("change", listener);
}
