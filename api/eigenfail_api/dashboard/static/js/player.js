// Plays a scene from above.
import { drawScene } from "./scene.js";
import { onThemeChange } from "./theme.js";

export function startPlayers() {
  for (const figure of document.querySelectorAll("[data-chart=player]")) start(figure);
}

function start(figure) {
  const scene = JSON.parse(figure.dataset.values);
  const canvas = figure.querySelector("canvas");
  const [play, scrub, speed, readout] = ["play", "scrub", "speed", "readout"]
    .map((part) => figure.querySelector(`[data-${part}]`));
  const last = scene.vehicles.length - 1;
  let step = 0;
  let before = null;

  const show = (wanted) => {
    step = Math.min(Math.max(wanted, 0), last);
    const whole = Math.floor(step);
    scrub.value = whole;
    readout.textContent = drawScene(canvas, scene, step);
    scrub.setAttribute("aria-valuetext", `${(whole * scene.dt).toFixed(1)} s`);
    document.dispatchEvent(new CustomEvent("eigenfail:time", { detail: { time: step * scene.dt } }));
  };
  const stop = () => {
    before = null;
    play.textContent = "Play";
  };
  const tick = (now) => {
    if (before === null) return;
    show(step + ((now - before) / 1000 / scene.dt) * Number(speed.value));
    before = now;
    if (step >= last) stop();
    else requestAnimationFrame(tick);
  };
  const toggle = () => {
    if (before !== null) return stop();
    if (step >= last) show(0);
    play.textContent = "Pause";
    before = performance.now();
    return requestAnimationFrame(tick);
  };

  play.addEventListener("click", toggle);
  scrub.addEventListener("input", () => { stop(); show(Number(scrub.value)); });
  for (const button of figure.querySelectorAll("[data-step]")) {
    button.addEventListener("click", () => { stop(); show(Math.floor(step) + Number(button.dataset.step)); });
  }
  new ResizeObserver(() => show(step)).observe(canvas);
  onThemeChange(() => show(step));
}
