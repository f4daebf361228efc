// Parts that take the service longer than the page: asked for once it stands, and again when
// something changed, but so seldom that they never cost more than a twentieth of the time.
import { tell } from "./notice.js";

const SHARE = 20;
const LEAST_MS = 2000;
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
    this.due = now + Math.max(LEAST_MS, SHARE * (now - this.began));
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
