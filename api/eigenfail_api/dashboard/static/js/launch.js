// The forms that launch campaigns and suites: their fields follow what is chosen, the service checks
// them, and what is in order goes to the public API under a key that makes one campaign of two clicks.
import { tell } from "./notice.js";

const UNANSWERED = "The service did not respond. Check that it is running, and try again.";

const TOO_LARGE = 413;

// What is typed while a drawing is under way, which does not know of it.
const typedMeanwhile = new Map();

let drawing = Promise.resolve();
let sending = false;

export function armLaunch() {
  const form = document.getElementById("launch");
  if (!form) return;
  document.addEventListener("change", ({ target }) => {
    if (target.matches("#launch [data-swaps]")) redraw("");
    if (target.matches("[data-import]")) importFile(target);
  });
  document.addEventListener("input", ({ target }) => {
    if (target.form?.id === "launch") typedMeanwhile.set(target.name, target.value);
  });
  // A file may be chosen before this script runs, and a browser keeps the file of a page that is reloaded. Its
  // change is not told then. Text that is there already may have been edited since, so it stays.
  const chosen = form.querySelector("[data-import]");
  if (chosen && !document.getElementById("import-text").value) importFile(chosen);
  document.addEventListener("htmx:response:error", ({ detail }) => refused(detail.ctx));
  document.addEventListener("htmx:error", ({ detail }) => {
    if (detail.ctx?.sourceElement?.id === "launch") tell(UNANSWERED);
  });
  document.addEventListener("submit", (event) => {
    if (event.target.id !== "launch") return;
    event.preventDefault();
    // Enter in a field comes by the first button there is, whichever that be.
    submit(event.submitter?.value || "check");
  });
}

async function submit(wish) {
  if (sending) return;
  sending = true;
  try {
    await redraw(wish);
    const { key } = document.getElementById("launch").dataset;
    if (wish === "launch" && key) await launch(document.getElementById("launch").dataset);
    else showWord();
  } finally {
    sending = false;
  }
}

async function importFile({ files: [file] }) {
  if (!file) return;
  document.getElementById("import-text").value = await file.text();
  submit("import");
}

// One drawing after the other: what is asked for while one is under way begins where that ends.
function redraw(wish) {
  drawing = drawing.catch(() => tell(UNANSWERED)).then(() => draw(wish));
  return drawing;
}

// The form as the service draws it for what is typed; where it draws none, there is no key.
async function draw(wish) {
  const form = document.getElementById("launch");
  form.dataset.key = "";
  form.querySelector("input[name=wish]").value = wish;
  typedMeanwhile.clear();
  await window.htmx.ajax("POST", form.dataset.draw, {
    source: form, target: "#launch", select: "#launch", swap: "outerMorph",
  });
  const { elements } = document.getElementById("launch");
  for (const [name, value] of typedMeanwhile) {
    if (elements.namedItem(name)) elements.namedItem(name).value = value;
  }
}

function refused({ sourceElement, response }) {
  if (sourceElement.id !== "launch") return;
  tell(response.raw.status === TOO_LARGE
    ? "The form exceeds the size limit of the service. Shorten it, or launch through the API."
    : "The service could not read the form. See its log.");
}

// A form that knows the page of what it creates names it; otherwise the answer has the id.
async function launch({ body, key, create, page }) {
  try {
    const response = await fetch(create, {
      method: "POST", headers: { "Content-Type": "application/json", "Idempotency-Key": key }, body,
    });
    const answer = await response.json();
    if (response.ok) window.location.assign(page || `/campaigns/${answer.id}`);
    else tell([answer.detail, answer.remedy].filter(Boolean).join(" "));
  } catch {
    tell(UNANSWERED);
  }
}

function showWord() {
  for (const wrong of document.querySelectorAll("#launch .is-wrong")) {
    for (let above = wrong.closest("details"); above; above = above.parentElement.closest("details")) above.open = true;
  }
  document.getElementById("launch-word").focus();
  document.getElementById("launch-word").scrollIntoView({ block: "start" });
}
