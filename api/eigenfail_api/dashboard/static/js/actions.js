// What buttons do: forms marked data-api go to the public API as JSON, which no foreign page can
// send unasked, and copies go to the clipboard.
import { refresh } from "./live.js";
import { tell } from "./notice.js";

export function arm() {
  document.addEventListener("submit", (event) => {
    if (!event.target.matches("form[data-api]")) return;
    event.preventDefault();
    const question = event.target.dataset.ask;
    if (question && !window.confirm(question)) return;
    send(event.target);
  });
}

async function send(form) {
  const button = form.querySelector("button");
  button.disabled = true;
  try {
    const response = await fetch(form.getAttribute("action"), {
      method: form.dataset.method ?? "POST",
      headers: { "Content-Type": "application/json" },
      body: JSON.stringify(fieldsOf(form)),
    });
    settle(form, response.ok, await response.json());
  } catch {
    tell("The service did not respond. Check that it is running, and try again.");
  } finally {
    button.disabled = false;
  }
}

function settle(form, done, answer) {
  if (!done) {
    tell([answer.detail, answer.remedy].filter(Boolean).join(" "));
  } else if (form.dataset.goto) {
    window.location.assign(form.dataset.goto + answer.id);
  } else {
    form.dispatchEvent(new CustomEvent("eigenfail:answered", { detail: answer }));
    refresh();
  }
}

function fieldsOf(form) {
  const filled = [...form.elements].filter((element) => element.name && element.value !== "");
  const fields = {};
  for (const element of filled) put(fields, element.name.split("."), valueOf(element));
  return fields;
}

function put(fields, [name, ...below], value) {
  if (below.length) put((fields[name] ??= {}), below, value);
  else fields[name] = value;
}

function valueOf({ dataset, value }) {
  if ("number" in dataset) return Number(value);
  if ("list" in dataset) return [value];
  return "numbers" in dataset ? value.split(",").map(Number) : value;
}

// A button with data-copy copies the text of its neighbour; without a clipboard it selects the text.
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
