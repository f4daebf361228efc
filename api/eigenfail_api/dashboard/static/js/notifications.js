// Notifications of the browser when campaigns end, while any page of the dashboard is open.
import { tell } from "./notice.js";

const KEY = "notify";
const POLL_MS = 5000;
// Each campaign is asked for by itself.
const MOST = 50;
const DENIED = "The browser does not allow notifications from this page. Allow them in its settings for this site.";

let isWatching = false;

export function armNotifications() {
  if (!("Notification" in window && window.isSecureContext && "locks" in navigator)) return;
  showButtons();
  watch();
  document.addEventListener("htmx:after:swap", showButtons);
  // Another page of the dashboard has changed the list, and may be closed before a campaign ends.
  window.addEventListener("storage", ({ key }) => {
    if (key !== KEY) return;
    showButtons();
    watch();
  });
  document.addEventListener("click", ({ target }) => {
    const button = target.closest("[data-notify]");
    if (button) toggle(button);
  });
}

function recall() {
  try {
    return JSON.parse(localStorage.getItem(KEY)) ?? [];
  } catch {
    return [];
  }
}

function keep(ids) {
  localStorage.setItem(KEY, JSON.stringify(ids));
  showButtons();
}

const idsOf = (button) => button.dataset.notify.split(",").map(Number);

function isOn(button) {
  const watched = recall();
  return idsOf(button).every((id) => watched.includes(id));
}

function showButtons() {
  for (const button of document.querySelectorAll("[data-notify]")) {
    button.hidden = false;
    button.textContent = isOn(button) ? button.dataset.stop : button.dataset.start;
  }
}

// Browsers ask for the permission only upon a click, and remember the answer.
async function toggle(button) {
  const ids = idsOf(button);
  const others = recall().filter((id) => !ids.includes(id));
  if (isOn(button)) {
    keep(others);
  } else if (others.length + ids.length > MOST) {
    tell(`At most ${MOST} campaigns can be watched at a time. Stop watching some of them.`);
  } else if (await Notification.requestPermission() === "granted") {
    keep([...others, ...ids]);
    watch();
  } else {
    tell(DENIED);
  }
}

// One page at a time asks for all of them; the lock passes to another page when that one is closed.
async function watch() {
  if (isWatching || !recall().length) return;
  isWatching = true;
  await navigator.locks.request(KEY, async () => {
    while (recall().length) {
      for (const id of recall()) await look(id);
      await new Promise((go) => { setTimeout(go, POLL_MS); });
    }
  });
  isWatching = false;
}

async function look(id) {
  try {
    const response = await fetch(`/api/v1/campaigns/${id}`);
    const campaign = response.ok ? await response.json() : null;
    // A campaign that this browser may no longer see is not asked for again.
    const isGone = [401, 403, 404].includes(response.status);
    if (!isGone && !campaign?.ended_ms) return;
    keep(recall().filter((each) => each !== id));
    if (campaign) announce(campaign);
  } catch {
    // The service is away for a moment: it is asked again.
  }
}

function announce({ id, state, spec, counts }) {
  const isErrored = counts.errored > 0 && counts.completed === 0;
  const title = `Campaign ${id} has ended: ${isErrored ? "errored" : state}`;
  const body = `${spec.name}: ${counts.failures} failures in ${counts.completed} completed episodes.`;
  try {
    const shown = new Notification(title, { body, tag: `eigenfail-${id}`, icon: "/static/favicon.svg" });
    shown.onclick = () => {
      window.focus();
      window.location.assign(`/campaigns/${id}`);
    };
  } catch {
    tell(`${title}. ${body}`); // Browsers of phones have notifications of service workers alone.
  }
}
