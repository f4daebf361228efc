// Plays scenes from above. The main one shares its time with the strips, the account, the address.
import { planAt, showAccount, takeAccount } from "./account.js";
import { fixed } from "./parts.js";
import { armKeys } from "./player_keys.js";
import { armLinks, keepInAddress, timeOfAddress } from "./player_links.js";
import { drawScene, wordsOf } from "./scene.js";
import { armStrips, showCursors } from "./strips.js";
import { onThemeChange } from "./theme.js";

const players = new WeakMap();
let main = null;

// What a player plays, by its data-player: an episode unless it says another kind.
const kinds = {
  "": {
    lastOf: (scene) => scene.vehicles.length - 1,
    firstShown: () => 0,
    timeAt: (scene, step) => step * scene.dt,
    draw: drawScene,
    wordsOf,
    arm: () => {},
  },
};

export function startPlayers(more = {}) {
  Object.assign(kinds, more);
  for (const stage of document.querySelectorAll("[data-player]")) {
    if (!players.has(stage)) players.set(stage, new Player(stage));
  }
  armKeys((stage) => players.get(stage), () => main);
  armLinks(seek);
  armStrips(seek);
  document.addEventListener("htmx:after:swap", refreshPlayers);
}

function refreshPlayers() {
  for (const stage of document.querySelectorAll("[data-player]")) {
    if (!players.has(stage)) players.set(stage, new Player(stage));
  }
  if (takeAccount()) main?.draw(true);
  const { arrived } = document.querySelector("[data-arrived]")?.dataset ?? {};
  if (arrived) window.location.replace(arrived);
}

function seek(time) {
  main?.seek(time);
}

class Player {
  constructor(stage) {
    this.stage = stage;
    this.scene = JSON.parse(stage.dataset.values);
    this.canvas = stage.querySelector("canvas");
    this.isMain = "main" in stage.dataset;
    for (const part of ["play", "scrub", "speed", "readout"]) this[part] = stage.querySelector(`[data-${part}]`);
    this.kind = kinds[stage.dataset.player];
    this.last = this.kind.lastOf(this.scene);
    Object.assign(this, { step: this.kind.firstShown(this.scene), told: -1, before: null });
    if (this.isMain) main = this;
    this.arm();
    const time = this.isMain ? timeOfAddress() : null;
    if (time !== null) this.step = this.stepAt(time);
    if (this.isMain) takeAccount();
    this.draw(true);
  }

  arm() {
    this.play.addEventListener("click", () => this.toggle());
    this.canvas.addEventListener("click", () => this.toggle());
    this.scrub.addEventListener("input", () => this.goTo(Number(this.scrub.value)));
    for (const button of this.stage.querySelectorAll("[data-step]")) {
      button.addEventListener("click", () => this.goBy(Number(button.dataset.step)));
    }
    this.kind.arm(this.stage, this.scene, () => this.draw(true));
    new ResizeObserver(() => this.draw()).observe(this.canvas);
    onThemeChange(() => this.draw());
  }

  stepAt(time) {
    return Math.min(Math.max(Math.round(time / this.scene.dt), 0), this.last);
  }

  get time() {
    return this.kind.timeAt(this.scene, Math.floor(this.step));
  }

  seek(time) {
    this.goTo(this.stepAt(time));
  }

  goBy(steps) {
    this.goTo(Math.floor(this.step) + steps);
  }

  goTo(step) {
    this.pause();
    this.step = Math.min(Math.max(step, 0), this.last);
    this.draw();
    if (this.isMain) keepInAddress(this.time);
  }

  draw(isNews = false) {
    const whole = Math.floor(this.step);
    this.kind.draw(this.canvas, this.scene, this.step, this.isMain ? planAt(whole) : null);
    if (this.isMain) showCursors(this.step * this.scene.dt);
    if (whole !== this.shown || isNews) this.tell(whole);
  }

  // Words change with the step, ten times a second; the drawing moves on in between.
  tell(whole) {
    this.shown = whole;
    this.scrub.value = whole;
    this.scrub.setAttribute("aria-valuetext", `${fixed(this.time)} s`);
    this.readout.textContent = this.kind.wordsOf(this.scene, whole);
    if (this.isMain) showAccount(whole);
  }

  toggle() {
    if (this.before !== null) {
      this.goTo(Math.floor(this.step));
      return;
    }
    if (this.step >= this.last) this.step = 0;
    this.play.textContent = "Pause";
    this.before = performance.now();
    requestAnimationFrame((now) => this.tick(now));
  }

  pause() {
    this.before = null;
    this.play.textContent = "Play";
  }

  tick(now) {
    if (this.before === null || !this.stage.isConnected) return;
    const passed = Math.max(now - this.before, 0) / 1000 / this.scene.dt;
    this.step = Math.min(this.step + passed * Number(this.speed.value), this.last);
    this.before = now;
    this.draw();
    if (this.step >= this.last) this.goTo(this.last);
    else requestAnimationFrame((next) => this.tick(next));
  }
}
