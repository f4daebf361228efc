// The time in the address, links to it, and jumps to moments.
import { tell } from "./notice.js";

const PATIENCE_MS = 200;

let timer = null;

export function timeOfAddress() {
  const given = new URLSearchParams(window.location.search).get("t");
  const time = Number(given);
  return given && Number.isFinite(time) ? time : null;
}

// Browsers take only so many changes in a time.
export function keepInAddress(time) {
  clearTimeout(timer);
  timer = setTimeout(() => window.history.replaceState(null, "", addressAt(time)), PATIENCE_MS);
}

export function armLinks(seek) {
  document.addEventListener("click", ({ target }) => {
    const jump = target.closest("[data-seek]");
    if (jump) seek(Number(jump.dataset.seek));
    const copier = target.closest("[data-copy-moment]");
    if (copier) copy(copier.closest("[data-player]").querySelector("[data-scrub]"));
  });
}

function addressAt(time) {
  const address = new URL(window.location.href);
  address.searchParams.set("t", time.toFixed(1));
  return address.href;
}

async function copy(scrub) {
  const address = addressAt(Number.parseFloat(scrub.getAttribute("aria-valuetext")));
  try {
    await navigator.clipboard.writeText(address);
    tell("Link copied.");
  } catch {
    tell(`The link to this moment: ${address}`);
  }
}
