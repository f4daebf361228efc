// Keys: a new one is shown once.
import "./main.js";

document.getElementById("new-key").addEventListener("eigenfail:answered", ({ detail: { key, token } }) => {
  const made = document.getElementById("made");
  for (const [name, text] of Object.entries({ name: key.name, token })) {
    made.querySelector(`[data-made=${name}]`).textContent = text;
  }
  made.hidden = false;
  document.getElementById("no-key")?.remove();
});
