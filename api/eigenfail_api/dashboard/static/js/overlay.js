// Failures of a mode over each other: the medoid, which is the first, opaque, the others translucent.
import { fixed } from "./parts.js";
import { palette } from "./palette.js";
import { blend, box, camera, drawContact, drawGround, drawScale, drawVehicle, isThere, prepare } from "./scene.js";

// What is farther from the medoid's ego than this does not widen the view.
const FARTHEST_M = 60;
// The opacity of a failure is INK ÷ number of failures, between these bounds, so that the road stays visible.
const INK = 3;
const FAINTEST = 0.06;
const STRONGEST = 0.3;

export const overlay = {
  lastOf: (scene) => scene.last,
  // The collision, in which all of them are there.
  firstShown: (scene) => scene.last,
  timeAt: (scene, step) => (step - (isAlignedAtEnd(scene) ? scene.last : 0)) * scene.dt,
  draw: drawOverlay,
  wordsOf: wordsOfOverlay,
  arm: armChoices,
};

function armChoices(stage, scene, redraw) {
  const [align, others] = ["align", "others"].map((name) => stage.querySelector(`[data-${name}]`));
  const take = () => {
    Object.assign(scene, { align: align.value, hasOthers: others.checked });
    redraw();
  };
  for (const choice of [align, others]) choice.addEventListener("change", take);
  Object.assign(scene, { align: align.value, hasOthers: others.checked });
}

const isAlignedAtEnd = (scene) => scene.align === "end";

// The failure's own step at a step of all; null before it begins. Its end stays.
function momentOf(scene, failure, step) {
  const own = isAlignedAtEnd(scene) ? step - scene.last + failure.last : step;
  return own < 0 ? null : Math.min(own, failure.last);
}

const poseAt = (failure, number, step) => failure.tracks[number].slice(3 * step, 3 * step + 3);

// Along a straight road, places are counted from the ego's at the moment at which all are aligned.
function originOf(scene, failure) {
  if (scene.road) return 0;
  return poseAt(failure, 0, isAlignedAtEnd(scene) ? failure.last : 0)[0];
}

function posesOf(scene, failure, moment) {
  const [from, origin] = [Math.floor(moment), originOf(scene, failure)];
  const to = Math.min(from + 1, failure.last);
  return failure.tracks.map((_, number) => {
    const pose = blend(poseAt(failure, number, from), poseAt(failure, number, to), moment - from);
    return isThere(pose) ? [pose[0] - origin, pose[1], pose[2]] : pose;
  });
}

function drawOverlay(canvas, scene, step) {
  const shown = scene.failures
    .map((failure) => ({ failure, moment: momentOf(scene, failure, step) }))
    .filter(({ moment }) => moment !== null)
    .map(({ failure, moment }) => ({ failure, poses: posesOf(scene, failure, moment), isOver: moment >= failure.last }));
  const pen = prepare(canvas);
  const view = camera(canvas, scene, scene.failures[0].sizes[0], followed(shown));
  drawGround(pen, view, scene);
  const opacity = Math.min(Math.max(INK / shown.length, FAINTEST), STRONGEST);
  // The medoid comes last, above the others.
  for (const one of shown.toReversed()) {
    if (one.failure === scene.failures[0]) drawMedoid(pen, view, scene, one);
    else drawFaint(pen, view, scene, one, opacity);
  }
  pen.globalAlpha = 1;
  drawScale(pen, view);
}

// Egos and the vehicles that they strike; the first failure is the medoid, if it has begun.
function followed(shown) {
  const all = shown.flatMap(({ failure, poses }) => [poses[0], poses[failure.struck]]).filter(isThere);
  return all.filter((pose) => Math.hypot(pose[0] - all[0][0], pose[1] - all[0][1]) <= FARTHEST_M);
}

const isDrawn = (scene, failure, number, pose) =>
  isThere(pose) && (number === 0 || number === failure.struck || scene.hasOthers);

function drawMedoid(pen, view, scene, { failure, poses, isOver }) {
  pen.globalAlpha = 1;
  poses.forEach((pose, number) => {
    if (isDrawn(scene, failure, number, pose)) drawVehicle(pen, view, failure.sizes[number], pose, number);
  });
  if (isOver && failure.collides) drawContact(pen, view, failure.sizes[0], poses[0]);
}

function drawFaint(pen, view, scene, { failure, poses }, opacity) {
  poses.forEach(([x, y, heading], number) => {
    if (!isDrawn(scene, failure, number, [x])) return;
    const ink = number ? palette().other : palette().ego;
    box(pen, view, x, y, heading, ...failure.sizes[number]);
    Object.assign(pen, { fillStyle: ink, strokeStyle: ink, lineWidth: 1, globalAlpha: opacity });
    pen.fill();
    pen.globalAlpha = Math.min(2 * opacity, 1);
    pen.stroke();
  });
}

function wordsOfOverlay(scene, step) {
  const moments = scene.failures.map((failure) => momentOf(scene, failure, step));
  const present = scene.failures.filter((_, place) => moments[place] !== null);
  const values = (name) => scene.failures
    .flatMap((failure, place) => (moments[place] === null ? [] : [failure[name][moments[place]]]))
    .filter((value) => value !== null);
  const over = present.filter((failure) => momentOf(scene, failure, step) === failure.last).length;
  return [
    `t = ${fixed(overlay.timeAt(scene, step))} s`,
    `${present.length} of ${scene.failures.length} failures have begun, ${over} have ended`,
    `egos ${range(values("speed"))} m/s`,
    ...(values("apart").length ? [`${range(values("apart"))} m apart`] : []),
  ].join(" · ");
}

function range(values) {
  const [low, high] = [Math.min(...values), Math.max(...values)].map((value) => fixed(value));
  return low === high ? low : `${low} to ${high}`;
}
