// Strips below the scene: one cursor at the time of the player, and a way to set that time.
const LEFT_PX = 62;
const RIGHT_PX = 18;

export function showCursors(time) {
  for (const strip of document.querySelectorAll("[data-strip]")) {
    const cursor = strip.querySelector("[data-cursor]");
    cursor.hidden = false;
    cursor.style.transform = `translateX(${(100 * time) / Number(strip.dataset.strip)}%)`;
  }
}

export function armStrips(seek) {
  document.addEventListener("pointerdown", (event) => point(event, seek));
  document.addEventListener("pointermove", (event) => { if (event.buttons === 1) point(event, seek); });
}

function point(event, seek) {
  const strip = event.target.closest?.("[data-strip]");
  if (!strip || event.button > 0) return;
  const box = strip.getBoundingClientRect();
  const share = (event.clientX - box.left - LEFT_PX) / (box.width - LEFT_PX - RIGHT_PX);
  seek(Math.min(Math.max(share, 0), 1) * Number(strip.dataset.strip));
}
