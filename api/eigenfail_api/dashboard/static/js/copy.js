// Buttons that copy the text beside them; where the clipboard is out of reach, the text is marked.
import { tell } from "./notice.js";

export function armCopies() {
  document.addEventListener("click", ({ target }) => {
    if (target.matches("[data-copy]")) copy(target.parentElement.querySelector("pre"));
  });
}

async function copy(pre) {
  try {
    await navigator.clipboard.writeText(pre.textContent);
    tell("Copied.");
  } catch {
    getSelection().selectAllChildren(pre);
    tell("The text is selected: copy it with Ctrl+C.");
  }
}
