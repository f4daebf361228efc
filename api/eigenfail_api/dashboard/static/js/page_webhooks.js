// Webhooks: the secret of a new one is shown once.
import "./main.js";

document.getElementById("new-webhook").addEventListener("eigenfail:answered", ({ detail: { webhook, secret } }) => {
  const made = document.getElementById("made");
  for (const [name, text] of Object.entries({ id: webhook.id, secret })) {
    made.querySelector(`[data-made=${name}]`).textContent = text;
  }
  made.hidden = false;
});
