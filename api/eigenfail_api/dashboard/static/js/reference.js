// The API's page: opens what an address points at, and asks the service for whoever tries a route.
const MOST_SHOWN = 20000;

document.addEventListener("submit", (event) => {
  if (!event.target.matches("form[data-try]")) return;
  event.preventDefault();
  attempt(event.target);
});
window.addEventListener("hashchange", open);
open();

function open() {
  const target = document.getElementById(decodeURIComponent(location.hash.slice(1)));
  if (!target?.matches("details")) return;
  target.open = true;
  target.scrollIntoView();
}

async function attempt(form) {
  const answer = form.nextElementSibling;
  const url = addressOf(form);
  answer.hidden = false;
  try {
    const response = await fetch(url, { headers: { Accept: form.dataset.accept } });
    show(answer, `${response.status} ${response.statusText} · ${url}`, await textOf(response));
  } catch {
    show(answer, `No response · ${url}`, "Check that the service is running, and try again.");
  }
}

function addressOf(form) {
  const inputs = [...form.querySelectorAll("input")].filter(({ value }) => value !== "");
  const query = new URLSearchParams();
  let path = form.dataset.path;
  for (const { name, value, dataset } of inputs) {
    if (dataset.where === "path") path = path.replace(`{${name}}`, encodeURIComponent(value));
    else query.append(name, value);
  }
  return query.size ? `${path}?${query}` : path;
}

async function textOf(response) {
  const kind = response.headers.get("content-type") ?? "";
  if (kind.includes("json")) return cut(JSON.stringify(await response.json(), null, 1));
  if (kind.startsWith("text/")) return cut(await response.text());
  return `${(await response.blob()).size} bytes of ${kind}`;
}

function cut(text) {
  if (text.length <= MOST_SHOWN) return text;
  return `${text.slice(0, MOST_SHOWN)}\n… ${text.length - MOST_SHOWN} characters more`;
}

function show(answer, line, text) {
  const status = document.createElement("p");
  const body = document.createElement("pre");
  status.textContent = line;
  body.textContent = text;
  body.tabIndex = 0;
  answer.replaceChildren(status, body);
}
