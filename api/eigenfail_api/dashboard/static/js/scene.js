// One moment of a scene on a canvas: x to the right, y up, one scale for both.
import { fixed } from "./parts.js";
import { palette } from "./palette.js";

const MARGIN_M = 8;
const LEAST_VIEW_M = 60;
const ALARM_M = 0.5;
const DOT_PX = 2.5;

export function drawScene(canvas, scene, step, plan) {
  const whole = Math.floor(step);
  const vehicles = between(scene, step);
  const actor = scene.nearest[whole];
  const seen = perceivedAt(scene, whole);
  const pen = prepare(canvas);
  const view = camera(canvas, scene, scene.sizes[0], [vehicles[0], vehicles[actor]]);
  drawGround(pen, view, scene);
  if (plan) drawPath(pen, view, plan);
  if (seen) drawSeen(pen, view, scene.sizes[actor], vehicles[actor], seen);
  vehicles.forEach((vehicle, number) => {
    if (isThere(vehicle)) drawVehicle(pen, view, scene.sizes[number], vehicle, number);
  });
  if (isContact(scene, whole)) drawContact(pen, view, scene.sizes[0], vehicles[0]);
  drawScale(pen, view);
}

// A simulator may see a contact that the footprints, rounded, do not show.
function isContact(scene, step) {
  return scene.apart[step] === 0 || (scene.collides && step === scene.vehicles.length - 1);
}

// The last moment has no perception; a vehicle that is not detected has no perceived position.
function perceivedAt(scene, step) {
  const seen = scene.perceived[step];
  return seen && seen[0] !== null ? seen : null;
}

// Vehicles may enter and leave: while one is not there it has no position.
export const isThere = (vehicle) => vehicle[0] !== null;

export function wordsOf(scene, step) {
  const whole = Math.floor(step);
  const [ego, actor] = [scene.vehicles[whole][0], scene.vehicles[whole][scene.nearest[whole]]];
  const seen = perceivedAt(scene, whole);
  const missed = !seen && whole < scene.perceived.length;
  const name = scene.kinds?.[scene.nearest[whole]] || "actor";
  const off = seen ? Math.hypot(seen[0] - actor[0], seen[1] - actor[1]) : 0;
  const parts = [
    `t = ${(whole * scene.dt).toFixed(1)} s`,
    `ego ${fixed(ego[3])} m/s`,
    `${name} ${fixed(actor[3])} m/s`,
    isContact(scene, whole) ? "collision" : `${apart(scene.apart[whole])} m apart`,
  ];
  return [...parts, ...(off > ALARM_M ? [`${name} seen ${off.toFixed(1)} m off`] : []), ...(missed ? [`${name} not detected`] : [])].join(" · ");
}

// What is apart is never told as 0.0.
const apart = (metres) => metres.toFixed(metres < 0.05 ? 3 : 1);

function between(scene, step) {
  const from = Math.floor(step);
  const to = Math.min(from + 1, scene.vehicles.length - 1);
  const share = step - from;
  if (share === 0) return scene.vehicles[from];
  return scene.vehicles[from].map((vehicle, number) => {
    const next = scene.vehicles[to][number];
    return blend(vehicle, next, share);
  });
}

// A pose between two; while the vehicle is not there in both, the first of them.
export function blend(from, to, share) {
  if (!isThere(from) || !isThere(to)) return from;
  return from.map((value, part) => value + share * (to[part] - value));
}

// The bitmap is made anew only where its size changed: that is what costs most.
export function prepare(canvas) {
  const density = window.devicePixelRatio || 1;
  const [width, height] = [canvas.clientWidth, canvas.clientHeight].map((side) => Math.round(side * density));
  if (canvas.width !== width) canvas.width = width;
  if (canvas.height !== height) canvas.height = height;
  const pen = canvas.getContext("2d");
  pen.setTransform(density, 0, 0, density, 0, 0);
  pen.clearRect(0, 0, canvas.clientWidth, canvas.clientHeight);
  pen.lineJoin = "round";
  return pen;
}

// The view holds the vehicles that it follows; `size` is that of the largest of them.
export function camera(canvas, scene, size, followed) {
  const [width, height] = [canvas.clientWidth, canvas.clientHeight];
  const [xs, ys] = [0, 1].map((part) => followed.map((vehicle) => vehicle[part]));
  const left = Math.min(...xs) - size[0] / 2 - MARGIN_M;
  const right = Math.max(...xs) + size[0] / 2 + MARGIN_M;
  const [low, high] = [Math.min(...ys), Math.max(...ys)];
  // A road that bends leads away from y = 0: the view follows the vehicles, and holds them.
  const across = scene.road ? high - low + 2 * MARGIN_M : 0;
  const scale = Math.min(width / Math.max(right - left, LEAST_VIEW_M), across ? height / across : Infinity);
  const middle = scene.road ? (low + high) / 2 : (Math.max(scene.lanes, 1) - 1) * scene.lane / 2;
  const x0 = (left + right - width / scale) / 2;
  return {
    scale,
    height,
    width,
    x0,
    x: (metres) => (metres - x0) * scale,
    y: (metres) => height / 2 - (metres - middle) * scale,
  };
}

export function drawGround(pen, view, scene) {
  if (scene.road) drawBorders(pen, view, scene.road);
  else drawRoad(pen, view, scene);
}

function drawRoad(pen, view, scene) {
  if (!scene.lanes) return;
  const edges = [-0.5, scene.lanes - 0.5].map((edge) => view.y(edge * scene.lane));
  pen.fillStyle = palette().road;
  pen.fillRect(0, edges[1], view.width, edges[0] - edges[1]);
  pen.strokeStyle = palette().muted;
  for (let edge = 0; edge <= scene.lanes; edge += 1) {
    const outer = edge === 0 || edge === scene.lanes;
    pen.lineWidth = outer ? 1.5 : 1;
    pen.setLineDash(outer ? [] : [4 * view.scale, 6 * view.scale]);
    // Dashes are painted on the road: they pass by as the view moves on.
    pen.lineDashOffset = outer ? 0 : view.x0 * view.scale;
    const y = view.y((edge - 0.5) * scene.lane);
    stroke(pen, [[0, y], [view.width, y]]);
  }
  pen.setLineDash([]);
  pen.lineDashOffset = 0;
}

function drawBorders(pen, view, borders) {
  pen.lineWidth = 1.5;
  for (const border of borders) stroke(pen, border.map(([x, y]) => [view.x(x), view.y(y)]), palette().muted);
}

// Pairs x, y, x, y …; hollow dots where something overrides the plan.
function drawPath(pen, view, { path, isOverridden }) {
  const points = [];
  for (let place = 0; place < path.length; place += 2) points.push([view.x(path[place]), view.y(path[place + 1])]);
  if (points.length < 2) return;
  pen.globalAlpha = 0.6;
  pen.lineWidth = 1.5;
  stroke(pen, points, palette().path);
  pen.globalAlpha = 1;
  pen.fillStyle = isOverridden ? palette().surface : palette().path;
  for (const [x, y] of points.slice(1)) {
    pen.beginPath();
    pen.arc(x, y, DOT_PX, 0, 2 * Math.PI);
    pen.fill();
    pen.stroke();
  }
}

export function drawVehicle(pen, view, [length, width], [x, y, heading], number) {
  box(pen, view, x, y, heading, length, width);
  pen.fillStyle = number ? palette().surface : palette().ego;
  pen.strokeStyle = number ? palette().other : palette().ego;
  pen.lineWidth = 2;
  pen.fill();
  pen.stroke();
  const nose = [x + (Math.cos(heading) * length) / 2, y + (Math.sin(heading) * length) / 2];
  pen.lineWidth = 3;
  stroke(pen, [[view.x(x), view.y(y)], [view.x(nose[0]), view.y(nose[1])]], number ? palette().other : palette().surface);
}

function drawSeen(pen, view, [length, width], [x, y, heading], [seenX, seenY]) {
  pen.setLineDash([5, 4]);
  pen.lineWidth = 1.5;
  stroke(pen, [[view.x(x), view.y(y)], [view.x(seenX), view.y(seenY)]], palette().seen);
  box(pen, view, seenX, seenY, heading, length, width);
  pen.stroke();
  pen.setLineDash([]);
}

export function drawContact(pen, view, [length, width], [x, y, heading]) {
  box(pen, view, x, y, heading, length + 1, width + 1);
  pen.strokeStyle = palette().bad;
  pen.lineWidth = 3;
  pen.stroke();
}

export function box(pen, view, x, y, heading, length, width) {
  const [cos, sin] = [Math.cos(heading) / 2, Math.sin(heading) / 2];
  pen.beginPath();
  for (const [front, side] of [[1, 1], [1, -1], [-1, -1], [-1, 1]]) {
    pen.lineTo(
      view.x(x + front * cos * length - side * sin * width),
      view.y(y + front * sin * length + side * cos * width),
    );
  }
  pen.closePath();
}

function stroke(pen, points, ink) {
  if (ink) pen.strokeStyle = ink;
  pen.beginPath();
  points.forEach((point) => pen.lineTo(...point));
  pen.stroke();
}

export function drawScale(pen, view) {
  const length = 10 * view.scale;
  const [right, bottom] = [view.width - 14, view.height - 12];
  pen.lineWidth = 1.5;
  stroke(pen, [[right - length, bottom - 4], [right - length, bottom], [right, bottom], [right, bottom - 4]], palette().ink);
  pen.fillStyle = palette().ink;
  pen.font = "12px sans-serif";
  pen.textAlign = "right";
  pen.fillText("10 m", right, bottom - 8);
}
