// Colours of the style sheet, for what is drawn on a canvas.
export const SYMBOLS = ["circle", "rect", "triangle", "diamond", "pin", "roundRect"];
export const DASHES = ["solid", "dashed", "dotted", [8, 3, 2, 3], [2, 2], [12, 4], [5, 2, 1, 2, 1, 2], [1, 4]];
const MARKS = 8;

// A variable holds the colours of both themes: an element that has it as its colour tells the one.
const probe = document.createElement("span");
probe.hidden = true;

export function colour(name) {
  if (!probe.isConnected) document.body.append(probe);
  probe.style.setProperty("color", `var(--${name})`);
  return getComputedStyle(probe).color;
}

export function mark(position) {
  return colour(`mark-${position % MARKS}`);
}

export function symbol(position) {
  return SYMBOLS[position % SYMBOLS.length];
}

// Where colours begin anew, another dash goes with each of them.
export function dash(position) {
  return DASHES[(position + Math.floor(position / MARKS)) % DASHES.length];
}

// Paper has the light theme. Its style sheet says so too late for what is drawn on a canvas: that
// is drawn again before the page is laid out for paper, and once more for the screen.
function setPaper(isPaper) {
  if (isPaper === "paper" in document.documentElement.dataset) return;
  if (isPaper) document.documentElement.dataset.paper = "";
  else delete document.documentElement.dataset.paper;
  tellAll();
}

const listeners = [];

window.addEventListener("beforeprint", () => setPaper(true));
window.addEventListener("afterprint", () => setPaper(false));
window.matchMedia("print").addEventListener("change", ({ matches }) => setPaper(matches));
window.matchMedia("(prefers-color-scheme: dark)").addEventListener("change", tellAll);
window.addEventListener("eigenfail:scheme", tellAll);

function tellAll() {
  for (const listener of listeners) listener();
}

export function onThemeChange(listener) {
  listeners.push(listener);
}

export function isForPaper() {
  return "paper" in document.documentElement.dataset;
}
