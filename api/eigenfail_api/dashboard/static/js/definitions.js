// What a figure is, beside the figure: a button opens it, Escape or anything outside closes it.
const EDGE_PX = 8;
const GAP_PX = 4;

let opener = null;

document.addEventListener("click", ({ target }) => {
  if (!target.closest("[data-term], #definition")) close();
});
document.addEventListener("keydown", ({ key }) => {
  if (key === "Escape" && opener) leave();
});
card().addEventListener("focusout", ({ relatedTarget }) => {
  if (relatedTarget && relatedTarget !== opener && !card().contains(relatedTarget)) close();
});

// A second click on the same button closes it.
export function define(button) {
  if (button === opener) leave();
  else open(button);
}

function card() {
  return document.getElementById("definition");
}

function open(button) {
  close();
  opener = button;
  fill(card(), button.dataset);
  button.setAttribute("aria-expanded", "true");
  // From its button the Tab key goes on into it.
  card().showPopover({ source: button });
  place(card(), button.getBoundingClientRect());
  card().focus({ preventScroll: true });
}

function close() {
  opener?.setAttribute("aria-expanded", "false");
  opener = null;
  card().hidePopover();
}

function leave() {
  const button = opener;
  close();
  button.focus();
}

function fill(into, { term, name, unit, words }) {
  into.querySelector("b").textContent = name;
  into.querySelector(".unit").textContent = unit && `[${unit}]`;
  into.querySelector(".definition-words").textContent = words;
  into.querySelector("a").href = `/glossary#${term}`;
}

// Below the button, or above it where the window ends; it scrolls with the page.
function place(box, { left, top, bottom }) {
  const { offsetWidth: width, offsetHeight: height } = box;
  const most = document.documentElement.clientWidth - width - EDGE_PX;
  const fits = bottom + GAP_PX + height <= window.innerHeight || top - GAP_PX - height < 0;
  box.style.left = `${window.scrollX + Math.max(EDGE_PX, Math.min(left, most))}px`;
  box.style.top = `${window.scrollY + (fits ? bottom + GAP_PX : top - GAP_PX - height)}px`;
}
