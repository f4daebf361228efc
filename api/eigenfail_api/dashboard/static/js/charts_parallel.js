// Every episode as a line over one axis for each measure.
import { axis, compact, legend } from "./parts.js";
import { colour } from "./theme.js";

const NARROW = 560;
const MANY = 300;
const WIDE_SPREAD = 1000;
const ABOVE_LINES = 10;
const AT_THE_END = { align: "right", verticalAlign: "bottom", padding: [0, 0, 4, 0] };

export function parallel({ columns, names, values, failure }, width) {
  const narrow = width < NARROW;
  const lines = failure.map((_, row) => values.map((axisValues) => axisValues[row] ?? "-"));
  const side = narrow ? 24 : 56;
  const series = (name, wanted, mark) => ({
    name,
    type: "parallel",
    data: lines.filter((_, row) => failure[row] === wanted),
    lineStyle: { width: 1, opacity: lines.length > MANY ? 0.25 : 0.5, color: colour(mark) },
    inactiveOpacity: 0.03,
    activeOpacity: 0.6,
    progressive: 500,
  });
  return {
    height: narrow ? 520 : 384,
    legend: legend({ itemWidth: 18 }),
    parallel: {
      left: side,
      right: side,
      top: 70,
      bottom: narrow ? 30 : 24,
      layout: narrow ? "vertical" : "horizontal",
      axisExpandable: false,
    },
    parallelAxis: columns.map((id, dim) => ({
      ...axis(names[dim], { nameLocation: "end", nameGap: narrow ? 6 : 14 }),
      id,
      dim,
      scale: true,
      type: scaleOf(values[dim]),
      realtime: false,
      nameTextStyle: { fontSize: 12, ...(narrow ? AT_THE_END : { align: "center" }), ...legible() },
      axisLabel: { fontSize: 11, formatter: compact, hideOverlap: true, ...legible() },
      z: ABOVE_LINES,
      areaSelectStyle: { width: 26, borderWidth: 1, borderColor: colour("accent"), color: colour("accent"), opacity: 0.25 },
    })),
    series: [
      series("safe", false, "safe"),
      series("failure", true, "mark-1"),
    ].filter(({ data }) => data.length),
  };
}

// Thousands of lines run below the words.
function legible() {
  return { color: colour("ink"), textBorderColor: colour("surface"), textBorderWidth: 4 };
}

// DRAC tends to infinity at contact: a few episodes would press all others into one point.
function scaleOf(values) {
  const known = values.filter((value) => value !== null).sort((a, b) => a - b);
  const middle = known[known.length >> 1];
  return known.length && known[0] > 0 && known.at(-1) > WIDE_SPREAD * middle ? "log" : "value";
}
