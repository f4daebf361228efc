// One stream of events for each visible tab: a browser lends six connections to a host, so a tab
// that nobody looks at gives its own back. Events say that something changed; the page asks what.
const LEAST_MS = 500;
const LOOK_MS = 2000;
const AGAIN_MS = 3000;
// Whoever looks must not cost the campaign more than a twentieth of its time.
const SHARE = 20;

const WORDS = { live: "live", lost: "connection lost, trying again", off: "not live" };

let source = null;
let opened = false;
let timer = null;
let asked = 0;
let tookMs = 0;

export function follow() {
  if (!region()) return;
  document.getElementById("feed").hidden = false;
  document.addEventListener("visibilitychange", () => (document.hidden ? close() : open()));
  window.addEventListener("pagehide", close);
  window.addEventListener("pageshow", (event) => { if (event.persisted) open(); });
  document.addEventListener("htmx:after:swap", noteTime);
  setInterval(lookWhileOpen, LOOK_MS);
  open();
}

export function refresh() {
  if (timer) return;
  const wait = Math.max(0, asked + Math.max(LEAST_MS, 2 * tookMs) - performance.now());
  timer = setTimeout(ask, wait);
}

function region() {
  return document.querySelector("[data-live]");
}

function open() {
  if (source || document.hidden) return;
  const { campaign, event } = region().dataset;
  const query = new URLSearchParams({ ...(campaign && { campaign }), ...(event && { after: event }) });
  source = new EventSource(`/api/v1/events?${query}`);
  source.onopen = listening;
  source.onerror = lost;
  source.onmessage = (event) => { if (event.data) refresh(); };
}

// The stream begins where the page was made. Results that came while it was cut are on no event.
function listening() {
  say("live");
  if (opened || region().dataset.event === undefined) refresh();
  opened = true;
}

// A browser tries again after a cut, but not after a refusal.
function lost() {
  say("lost");
  if (source.readyState !== EventSource.CLOSED) return;
  source = null;
  setTimeout(open, AGAIN_MS);
}

function close() {
  source?.close();
  source = null;
  clearTimeout(timer);
  timer = null;
  say("off");
}

function ask() {
  timer = null;
  asked = performance.now();
  window.htmx.trigger(document.body, "eigenfail:refresh");
}

function noteTime(event) {
  if (event.detail.ctx.sourceElement === region()) tookMs = performance.now() - asked;
}

// Results alone make no event: a campaign that runs is looked at in between.
function lookWhileOpen() {
  const idle = performance.now() - asked > SHARE * tookMs;
  const listens = source?.readyState === EventSource.OPEN;
  if (listens && idle && region().dataset.open === "true") refresh();
}

function say(state) {
  const feed = document.getElementById("feed");
  feed.dataset.feed = state;
  feed.querySelector(".feed-word").textContent = WORDS[state];
}
