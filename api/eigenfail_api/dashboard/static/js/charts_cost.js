// Cost per failure: a mark with its interval for each campaign, or an arrow from its lower bound.
import { axis, compact, legend, strokes, tip, tooltip } from "./parts.js";
import { colour, mark, symbol } from "./theme.js";

const ROW_PX = 30;
const NARROW_PX = 520;

export function cost({ campaigns }, width) {
  const methods = [...new Set(campaigns.map((one) => one.method))].sort();
  const bounds = campaigns.map((one, row) => ({ ...one, row })).filter((one) => one.value === null);
  const found = campaigns.map((one, row) => ({ ...one, row })).filter((one) => one.value !== null);
  const names = width < NARROW_PX ? 96 : 200;
  return {
    height: 84 + ROW_PX * campaigns.length,
    // The names are cut to the room there is: their widths need not be measured for it.
    grid: { left: names + 14, right: 30, top: 34, bottom: 46, outerBoundsMode: "none" },
    legend: legend({ data: methods }),
    xAxis: axis("USD per failure", { type: "log", ...decades(campaigns), axisLabel: { color: colour("muted"), formatter: compact, hideOverlap: true } }),
    yAxis: axis("", {
      type: "category",
      inverse: true,
      data: campaigns.map((one) => one.label ?? `${one.id} ${one.name}`),
      axisTick: { show: false },
      axisLabel: { color: colour("ink"), width: names, overflow: "truncate", interval: 0 },
    }),
    tooltip: tooltip(({ data }) => tip(data.one.name, linesOf(data.one))),
    series: [
      strokes(found.filter((one) => one.low !== null).map((one) => [[one.low, one.row], [one.high, one.row]]), { width: 2 }),
      ...methods.map((method) => marks(method, [...found, ...bounds])),
    ],
  };
}

function marks(method, campaigns) {
  return {
    name: method,
    type: "scatter",
    ...looksOf(method),
    symbolSize: 13,
    data: campaigns.filter((one) => one.method === method).map((one) => (one.value === null ? arrow(one) : point(one))),
  };
}

const point = (one) => ({ value: [one.value, one.row], link: one.id, one });

function arrow(one) {
  return {
    value: [one.at_least, one.row],
    link: one.id,
    one,
    symbol: "path://M0,-4 L12,-4 L12,-9 L22,0 L12,9 L12,4 L0,4 Z",
    symbolSize: [24, 15],
    symbolOffset: ["50%", 0],
  };
}

// Whole decades, so that an axis of a single value has room too.
function decades(campaigns) {
  const values = campaigns.flatMap((one) => [one.value, one.low, one.high, one.at_least]).filter((value) => value > 0);
  return {
    min: 10 ** Math.floor(Math.log10(Math.min(...values))),
    max: 10 ** Math.ceil(Math.log10(Math.max(...values)) + 0.15),
  };
}

function interval(one) {
  if (one.low !== null) return `, ${compact(one.low)} – ${compact(one.high)}`;
  return one.at_least === null ? "" : `, at least ${compact(one.at_least)} (95 %)`;
}

function linesOf(one) {
  const found = one.value === null
    ? `at least ${compact(one.at_least)} USD per failure (95 %)`
    : `${compact(one.value)} USD per failure${interval(one)}`;
  return [one.method, found, `${one.failures} failures in ${one.completed} episodes`];
}

// Methods that have a look of their own, in order; each declares its place in its class.
const KNOWN = (document.documentElement.dataset.methods ?? "").split(" ");

// Number of different pairs of a colour and a shape. Methods of plugins share the remaining pairs.
const PAIRS = 24;

// A method looks the same in every chart of every page.
export function looksOf(method) {
  const place = KNOWN.indexOf(method);
  const position = place >= 0 ? place : KNOWN.length + (sumOf(method) % (PAIRS - KNOWN.length));
  return { symbol: symbol(position), itemStyle: { color: mark(position) } };
}

// Of its name alone: what else a page shows changes nothing.
function sumOf(name) {
  return [...name].reduce((sum, letter) => (31 * sum + letter.codePointAt(0)) % 1_000_003, 0);
}
