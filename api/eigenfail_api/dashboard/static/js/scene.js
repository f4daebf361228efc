// One moment of a scene on a canvas: x to the right, y up, one scale for both.
import { colour } from "./theme.js";

const MARGIN_M = 8;
const LEAST_VIEW_M = 60;
const ALARM_M = 0.5;

export function drawScene(canvas, scene, step) {
  const whole = Math.floor(step);
  const vehicles = between(scene, step);
  const actor = scene.nearest[whole];
  const seen = scene.perceived[Math.min(whole, scene.perceived.length - 1)];
  const pen = prepare(canvas);
  const view = camera(canvas, scene, vehicles[0], vehicles[actor]);
  drawRoad(pen, view, scene);
  if (seen) drawSeen(pen, view, scene.sizes[actor], vehicles[actor], seen);
  vehicles.forEach((vehicle, number) => drawVehicle(pen, view, scene.sizes[number], vehicle, number));
  drawScale(pen, view);
  return words(scene, step, vehicles[0], vehicles[actor], seen);
}

function between(scene, step) {
  const from = Math.floor(step);
  const to = Math.min(from + 1, scene.vehicles.length - 1);
  const share = step - from;
  return scene.vehicles[from].map((vehicle, number) => vehicle.map((value, part) => (
    value + share * (scene.vehicles[to][number][part] - value)
  )));
}

function prepare(canvas) {
  const density = window.devicePixelRatio || 1;
  canvas.width = canvas.clientWidth * density;
  canvas.height = canvas.clientHeight * density;
  const pen = canvas.getContext("2d");
  pen.scale(density, density);
  return pen;
}

function camera(canvas, scene, ego, actor) {
  const left = Math.min(ego[0] - scene.sizes[0][0] / 2, actor[0] - scene.sizes[0][0] / 2) - MARGIN_M;
  const right = Math.max(ego[0], actor[0]) + scene.sizes[0][0] / 2 + MARGIN_M;
  const width = Math.max(right - left, LEAST_VIEW_M);
  const scale = canvas.clientWidth / width;
  const middle = (Math.max(scene.lanes, 1) - 1) * scene.lane / 2;
  const x0 = (left + right - width) / 2;
  return {
    scale,
    height: canvas.clientHeight,
    width: canvas.clientWidth,
    x0,
    x: (metres) => (metres - x0) * scale,
    y: (metres) => canvas.clientHeight / 2 - (metres - middle) * scale,
  };
}

function drawRoad(pen, view, scene) {
  for (let edge = 0; scene.lanes && edge <= scene.lanes; edge += 1) {
    const outer = edge === 0 || edge === scene.lanes;
    pen.strokeStyle = colour("muted");
    pen.lineWidth = outer ? 1.5 : 1;
    pen.setLineDash(outer ? [] : [4 * view.scale, 6 * view.scale]);
    // Dashes are painted on the road: they pass by as the view moves on.
    pen.lineDashOffset = outer ? 0 : view.x0 * view.scale;
    const y = view.y((edge - 0.5) * scene.lane);
    stroke(pen, [[0, y], [view.width, y]]);
  }
  pen.setLineDash([]);
}

function drawVehicle(pen, view, [length, width], [x, y, heading], number) {
  box(pen, view, x, y, heading, length, width);
  pen.fillStyle = number ? colour("surface") : colour("mark-0");
  pen.strokeStyle = number ? colour("mark-1") : colour("mark-0");
  pen.lineWidth = 2;
  pen.fill();
  pen.stroke();
  const nose = [x + (Math.cos(heading) * length) / 2, y + (Math.sin(heading) * length) / 2];
  pen.lineWidth = 3;
  stroke(pen, [[view.x(x), view.y(y)], [view.x(nose[0]), view.y(nose[1])]], number ? colour("mark-1") : colour("surface"));
}

function drawSeen(pen, view, [length, width], [x, y, heading], [seenX, seenY]) {
  pen.setLineDash([5, 4]);
  pen.lineWidth = 1.5;
  stroke(pen, [[view.x(x), view.y(y)], [view.x(seenX), view.y(seenY)]], colour("mark-3"));
  box(pen, view, seenX, seenY, heading, length, width);
  pen.strokeStyle = colour("mark-3");
  pen.stroke();
  pen.setLineDash([]);
}

function box(pen, view, x, y, heading, length, width) {
  const [along, across] = [[Math.cos(heading), Math.sin(heading)], [-Math.sin(heading), Math.cos(heading)]];
  const corners = [[1, 1], [1, -1], [-1, -1], [-1, 1]].map(([front, side]) => [
    view.x(x + (front * along[0] * length + side * across[0] * width) / 2),
    view.y(y + (front * along[1] * length + side * across[1] * width) / 2),
  ]);
  pen.beginPath();
  corners.forEach((corner) => pen.lineTo(...corner));
  pen.closePath();
}

function stroke(pen, points, ink) {
  if (ink) pen.strokeStyle = ink;
  pen.beginPath();
  points.forEach((point) => pen.lineTo(...point));
  pen.stroke();
}

function drawScale(pen, view) {
  const length = 10 * view.scale;
  const [right, bottom] = [view.width - 14, view.height - 12];
  pen.lineWidth = 1.5;
  stroke(pen, [[right - length, bottom - 4], [right - length, bottom], [right, bottom], [right, bottom - 4]], colour("ink"));
  pen.fillStyle = colour("ink");
  pen.font = "12px sans-serif";
  pen.textAlign = "right";
  pen.fillText("10 m", right, bottom - 8);
}

function words(scene, step, ego, actor, seen) {
  const off = seen ? Math.hypot(seen[0] - actor[0], seen[1] - actor[1]) : 0;
  const parts = [
    `t = ${(step * scene.dt).toFixed(1)} s`,
    `ego ${ego[3].toFixed(1)} m/s`,
    `actor ${actor[3].toFixed(1)} m/s`,
    `centres ${Math.hypot(actor[0] - ego[0], actor[1] - ego[1]).toFixed(1)} m apart`,
  ];
  return [...parts, ...(off > ALARM_M ? [`actor seen ${off.toFixed(1)} m off`] : [])].join(" · ");
}
