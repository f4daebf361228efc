// What keeps a page up to date: a stream of events, and parts that come later.
import { tell } from "./notice.js";

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

// Parts that take the service longer than the page: asked for once it stands, and again when
// something changed, but so seldom that they never cost more than a twentieth of the time.
const PART_LEAST_MS = 2000;
const BUSY = 503;

class Part {
  constructor() {
    Object.assign(this, { timer: null, began: null, due: 0, wanted: false });
  }

  // What changes while it is under way is asked for after it.
  want(id) {
    this.wanted = true;
    if (this.timer || this.began !== null) return;
    this.timer = setTimeout(() => this.ask(id), Math.max(0, this.due - performance.now()));
  }

  ask(id) {
    Object.assign(this, { timer: null, wanted: false, began: performance.now() });
    window.htmx.trigger(document.getElementById(id), "eigenfail:ask");
  }

  end(id) {
    const now = performance.now();
    this.due = now + Math.max(PART_LEAST_MS, SHARE * (now - this.began));
    this.began = null;
    if (this.wanted) this.want(id);
  }
}

const parts = new Map();

export function fetchLater() {
  for (const { id } of document.querySelectorAll("[data-later]")) parts.set(id, new Part());
  document.body.addEventListener("eigenfail:refresh", () => wantAll("[data-later]"));
  document.addEventListener("htmx:response:error", ({ detail }) => refused(detail.ctx));
  document.addEventListener("htmx:finally:request", ({ detail }) => {
    const { id } = detail.ctx.sourceElement;
    parts.get(id)?.end(id);
  });
  wantAll("[data-later=wanted]");
}

function wantAll(which) {
  for (const { id } of document.querySelectorAll(which)) parts.get(id).want(id);
}

// A service that is busy with the same work for others will do it later.
function refused({ sourceElement: { id }, response }) {
  if (!parts.has(id)) return;
  if (response.status === BUSY) parts.get(id).want(id);
  else tell("A part of this page could not be computed. See the log of the service.");
}
