// The planner's account of each step: its words at the moment, and the path that it means to drive.
import { fixed } from "./parts.js";

const NONE = "–";
const PLAIN = ["mode", "rule", "candidate", "heeds"];

let text = null;
let account = null;

// Takes the account in once it is on the page; whether that was news.
export function takeAccount() {
  const panel = document.querySelector("[data-account]");
  if (!panel || panel.dataset.account === text) return false;
  text = panel.dataset.account;
  account = JSON.parse(text);
  return true;
}

export function planAt(step) {
  const path = account?.path[step];
  return path?.length ? { path, isOverridden: isOverridden(account.override[step]) } : null;
}

export function showAccount(step) {
  const panel = document.querySelector("[data-account]");
  if (!panel || !account) return;
  const at = Math.min(step, account.mode.length - 1);
  for (const name of PLAIN) say(panel, name, words(account[name][at]));
  say(panel, "override", words(account.override[at]), isOverridden(account.override[at]));
  say(panel, "gap", pair(account.gap_m[at], account.true_gap_m[at], "m"));
  say(panel, "closing", pair(account.closing_mps[at], account.true_closing_mps[at], "m/s"));
}

function isOverridden(name) {
  return name !== "" && name !== "none";
}

function words(name) {
  return name ? name.replaceAll("_", " ") : NONE;
}

function pair(believed, truth, unit) {
  return `${figure(believed)} / ${figure(truth)} ${unit}`;
}

function figure(value) {
  return value === null || value === undefined ? NONE : fixed(value);
}

function say(panel, name, told, isAlarm = false) {
  const field = panel.querySelector(`[data-field=${name}]`);
  if (field.textContent !== told) field.textContent = told;
  field.classList.toggle("is-alarm", isAlarm);
}
