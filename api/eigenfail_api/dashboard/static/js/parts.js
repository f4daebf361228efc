// Pieces that all charts share, and figures as charts and players write them.
import { colour } from "./theme.js";

export const signed = (text) => text.replace(/^-/, "−");

// A fixed number of decimals; what rounds to zero has no sign.
export function fixed(value, decimals = 1) {
  const text = value.toFixed(decimals);
  return Number(text) === 0 ? (0).toFixed(decimals) : signed(text);
}

export const capitalized = (text) => `${text[0].toUpperCase()}${text.slice(1)}`;

// Thousands of points are drawn as one shape, and still told apart by the pointer.
export const MANY = { large: true, largeThreshold: 500 };

export const compact = (value) => (value === null || value === undefined ? "–" : plain(value));

const RAISED = "⁰¹²³⁴⁵⁶⁷⁸⁹";

function plain(value) {
  // By hand: the browser's formatter takes longer to begin than a chart to be drawn.
  const rounded = Number(value.toPrecision(4));
  const size = Math.abs(rounded);
  if (value !== 0 && (size < 1e-3 || size >= 1e6)) return scientific(value);
  return signed(size < 1e3 ? String(rounded) : String(rounded).replace(/\d{3}$/, ",$&"));
}

function scientific(value) {
  const [mantissa, exponent] = value.toExponential(2).split("e");
  const raised = [...String(Math.abs(exponent))].map((digit) => RAISED[digit]).join("");
  const factor = Number(mantissa) === 1 ? "" : `${Number(mantissa)}×`;
  return signed(`${factor}10${exponent < 0 ? "⁻" : ""}${raised}`);
}

export function axis(name, more = {}) {
  const quiet = { color: colour("muted"), fontSize: 12 };
  return {
    type: "value",
    name,
    nameLocation: "middle",
    nameGap: 30,
    nameTextStyle: quiet,
    axisLabel: { ...quiet, hideOverlap: true, formatter: told },
    axisLine: { show: true, lineStyle: { color: colour("line") } },
    axisTick: { lineStyle: { color: colour("line") } },
    splitLine: { lineStyle: { color: colour("grid") } },
    ...more,
  };
}

// Categories are words already.
const told = (value) => (typeof value === "number" ? compact(value) : value);

export const yAxis = (name, more = {}) => axis(name, { nameGap: 44, ...more });

export const grid = (more = {}) => ({ left: 62, right: 18, top: 34, bottom: 48, ...more });

export function legend(more = {}) {
  return {
    top: 0,
    left: 0,
    type: "plain",
    itemWidth: 12,
    itemHeight: 11,
    itemGap: 16,
    textStyle: { color: colour("ink"), fontSize: 12 },
    ...more,
  };
}

// The names of channels, with the room that their rows take beyond the first one.
export function channelLegend(names, width) {
  return { legend: legend({ data: names, itemWidth: 30 }), excess: legendExcess(names, width, 70) };
}

// The legend wraps: about seven pixels a letter, and the sign before it.
const LEGEND_ROW_PX = 25;

export function legendExcess(names, width, sign = 50) {
  const [rows] = names.reduce(([row, used], name) => {
    const wide = sign + 7 * name.length;
    return used + wide > width ? [row + 1, wide] : [row, used + wide];
  }, [0, 0]);
  return LEGEND_ROW_PX * rows;
}

// An element, not markup: names come from users, and the policy forbids inline styles.
export function tip(title, lines) {
  const box = document.createElement("div");
  box.className = "tip";
  const head = document.createElement("b");
  head.textContent = title;
  box.append(head);
  for (const line of lines) {
    const row = document.createElement("div");
    row.textContent = line;
    box.append(row);
  }
  return box;
}

export function tooltip(formatter, more = {}) {
  return {
    confine: true,
    backgroundColor: colour("surface"),
    borderColor: colour("line"),
    transitionDuration: 0,
    formatter,
    ...more,
  };
}

// Vertical or horizontal strokes: pairs of points with a gap behind each.
export function strokes(pairs, line = {}) {
  return {
    type: "line",
    data: pairs.flatMap(([from, to]) => [from, to, ["-", "-"]]),
    symbol: "none",
    silent: true,
    animation: false,
    lineStyle: { width: 1.5, color: colour("muted"), ...line },
    tooltip: { show: false },
  };
}
