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

// Paper has the light theme. Its style sheet says so too late for what is drawn on a canvas: that
// is drawn again before the page is laid out for paper, and once more for the screen.
function setPaper(isPaper) {
  if (isPaper === "paper" in document.documentElement.dataset) return;
  if (isPaper) document.documentElement.dataset.paper = "";
  else delete document.documentElement.dataset.paper;
  for (const listener of listeners) listener();
}

const listeners = [];

window.addEventListener("beforeprint", () => setPaper(true));
window.addEventListener("afterprint", () => setPaper(false));
window.matchMedia("print").addEventListener("change", ({ matches }) => setPaper(matches));
window.matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
  for (const listener of listeners) listener();
});

export function onThemeChange(listener) {
  listeners.push(listener);
}

export function isForPaper() {
  return "paper" in document.documentElement.dataset;
}
