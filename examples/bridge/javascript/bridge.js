// A bridge: a truck that keeps its distance behind a car that brakes.
// docs/bridge.md has the protocol.   node bridge.js tcp://127.0.0.1:9000
import { decode, encode } from "@msgpack/msgpack";
import { Reply } from "zeromq";

const DT_S = 0.1;
const PARAMETERS = { speed_mps: 20, brakes_at_s: 2, deceleration_mps2: 5 };
const SETTINGS = { headway_s: 0.8, standstill_m: 1 };
const CHANNELS = ["longitudinal", "lateral", "speed", "missed"];
const WELCOME = {
  type: "welcome", protocol: 2, name: "point masses in JavaScript", version: "1", slots: 32,
  scenarios: [{ name: "braking_lead", dt_s: DT_S, steps: 120, parameters: PARAMETERS }],
  planners: [{ name: "headway", settings: SETTINGS }],
  channels: CHANNELS, signals: [{ name: "wanted_gap_m", unit: "m" }], seed_text: true,
};

const refuseUnless = (kept, message, whose = "input") => { if (!kept) throw Object.assign(new Error(message), { whose }); };

// The simulator: two point masses on a straight lane.
class Episode {
  constructor({ scenario, planner, parameters, settings, steps, channels, explain }) {
    const given = { ...parameters, ...settings }, defaults = { ...PARAMETERS, ...SETTINGS };
    refuseUnless(scenario === "braking_lead" && planner === "headway", "There is no such scenario or planner.");
    refuseUnless(channels.every(({ name }) => CHANNELS.includes(name)), "There is no such channel.");
    for (const name in given) refuseUnless(typeof given[name] === typeof defaults[name], `${name} is no parameter, or no number.`);
    Object.assign(this, { steps, explain, step: 0, set: { ...defaults, ...given } });
    this.ego = { x: 0, v: this.set.speed_mps, length: 12 };
    this.lead = { x: 8.5 + this.wantedGap(), v: this.set.speed_mps, length: 5 };
  }

  wantedGap() {
    return this.set.standstill_m + this.set.headway_s * this.ego.v;
  }

  // The planner: keeps a time headway behind the car that it sees in its lane.
  decide(seen) {
    const free = 0.5 * (this.set.speed_mps - this.ego.v);
    this.account = { heeds: seen ? "lead" : "nobody", seen_at_m: seen ? seen.x : 0 };
    if (!seen || Math.abs(seen.y) > 2) return free;
    const gap = seen.x - this.ego.x - 8.5;
    return Math.min(free, 0.4 * (gap - this.wantedGap()) + 1.2 * (seen.v - this.ego.v));
  }

  advance({ longitudinal = 0, lateral = 0, speed = 0, missed = 0 }) {
    refuseUnless(!this.show().ended, "The episode is over.", "simulator");
    const seen = missed > 0.5 ? null : { x: this.lead.x + longitudinal, y: lateral, v: this.lead.v + speed };
    const asked = this.decide(seen);
    const given = Math.min(Math.max(asked, -6), 1.5);
    const brakes = this.step * DT_S >= this.set.brakes_at_s;
    for (const [one, a] of [[this.ego, given], [this.lead, brakes ? -this.set.deceleration_mps2 : 0]]) {
      one.v = Math.max(one.v + a * DT_S, 0);
      one.x += one.v * DT_S;
    }
    this.step += 1;
    const path = [[this.ego.x, 0], [this.ego.x + 2 * this.ego.v, 0]];
    const told = { control: [asked, 0], applied: [given, 0], perceived: seen && [seen.x, seen.y] };
    return { ...this.show(), ...told, ...(this.explain && { account: this.account, path }) };
  }

  show() {
    const [ego, lead] = [this.ego, this.lead].map(({ x, v, length }) => [x, 0, 0, v, length, 2.5]);
    const collided = this.lead.x - this.ego.x - 8.5 <= 0, ended = collided || this.step >= this.steps;
    const road = this.step ? null : [[[-50, 2], [500, 2]], [[-50, -2], [500, -2]]]; // the borders of the lane
    return { step: this.step, ego, others: [lead], collided, ended, kinds: ["car"], road, signals: { wanted_gap_m: this.wantedGap() } };
  }
}

const sessions = new Map(); // By name: episodes by slot. Those that asked last come last, and the first one makes room.

function act(episodes, type, asked) {
  try {
    if (type === "reset") return episodes.set(asked.slot, new Episode(asked)).get(asked.slot).show();
    refuseUnless(episodes.has(asked.slot), "There is no episode to go on with.", "simulator");
    return episodes.get(asked.slot).advance(asked.disturbances);
  } catch (error) {
    episodes.delete(asked.slot);
    return { fault: error.whose ?? "simulator", message: error.message };
  }
}

function answer({ type, id = 0, session, protocol, slots }) {
  const episodes = sessions.get(session) ?? new Map();
  const known = sessions.delete(session);
  if (type === "hello" && protocol !== 2) return { type: "refusal", reason: "I speak protocol 2." };
  if (type !== "hello" && !known) return { type: "error", id, fault: "simulator", message: "I do not know this session.", lost: true };
  if (type === "close") return { type: "closed", id };
  if (sessions.size >= 64) sessions.delete(sessions.keys().next().value);
  sessions.set(session, type === "hello" ? new Map() : episodes);
  if (type === "hello") return WELCOME;
  return { type: "observations", id, slots: slots.map((each) => act(episodes, type, each)) };
}

const socket = new Reply();
await socket.bind(process.argv[2]);
for await (const [data] of socket) {
  let said = { type: "error", id: 0, fault: "simulator", message: "The request cannot be read." };
  try { said = answer(decode(data)); } catch {}
  await socket.send(encode(said));
}
