// Intervals of the training, one below the other: each line swings about a row of its own.
import { axis, capitalized, compact, legend, tip, tooltip } from "./parts.js";
import { colour, dash, mark } from "./theme.js";

const NARROW_PX = 620;
const PANEL_PX = 380;
const BESIDE = 2;
const HEADING_PX = 22;
const SWING = 0.9;

export function training(values, width) {
  const stacked = width < NARROW_PX;
  const channels = Object.entries(values.channels);
  const top = topOf(values, stacked);
  return {
    height: top + PANEL_PX * Math.ceil(channels.length / (stacked ? 1 : BESIDE)),
    legend: legend({
      data: values.names.length > 1 ? values.names : [],
      selected: Object.fromEntries(values.names.map((name, position) => [name, !position])),
      itemWidth: 30,
      inactiveColor: colour("muted"),
      inactiveBorderColor: colour("muted"),
    }),
    grid: channels.map((_, panel) => place(panel, stacked, top)),
    xAxis: channels.map((_, panel) => axis("Step", { gridIndex: panel, nameGap: 26, max: "dataMax" })),
    yAxis: channels.map(([name, intervals], panel) => rows(name, intervals, panel, values)),
    tooltip: tooltip(({ seriesName, data }) => tip(`Episodes ${data[3]}`, [
      seriesName, `step ${data[0]}: ${compact(data[2])}`,
    ])),
    series: channels.flatMap(([, intervals], panel) => lines(intervals, panel, values)),
  };
}

// Below the legend, which takes two lines where there is little room.
function topOf({ names }, stacked) {
  if (names.length < 2) return 14;
  return stacked ? 48 : 28;
}

function place(panel, stacked, top) {
  const height = PANEL_PX - HEADING_PX - 50;
  if (stacked) return { left: 74, right: 12, top: top + HEADING_PX + panel * PANEL_PX, height };
  const row = Math.floor(panel / BESIDE);
  return { left: panel % BESIDE ? "59%" : 74, width: "38%", top: top + HEADING_PX + row * PANEL_PX, height };
}

// Where it swings by as much as a row is high, a line reaches the next one.
const heading = (name, intervals, unit) => (
  `${capitalized(name)}: a row is ${`${compact(scaleOf(intervals))} ${unit}`.trim()} high`
);

function rows(name, intervals, panel, { spans, unit }) {
  const last = spans.length - 1;
  return axis(heading(name, intervals, unit), {
    gridIndex: panel,
    nameLocation: "start",
    nameGap: 8,
    nameTextStyle: { color: colour("ink"), fontSize: 12, align: "left" },
    inverse: true,
    min: -1,
    max: last + 1,
    interval: 1,
    axisLabel: { color: colour("muted"), fontSize: 11, formatter: (row) => spans[row] ?? "", hideOverlap: true },
    axisTick: { show: false },
  });
}

function lines(intervals, panel, { names, steps, spans }) {
  const scale = scaleOf(intervals);
  return intervals.flatMap((interval, row) => interval.map((line, position) => ({
    name: names[position],
    type: "line",
    xAxisIndex: panel,
    yAxisIndex: panel,
    data: line.map((value, point) => [steps[point], row - (SWING * value) / scale, value, spans[row]]),
    symbol: "circle",
    symbolSize: 6,
    showSymbol: false,
    itemStyle: { color: mark(position) },
    lineStyle: { color: mark(position), type: dash(position), width: 1.5 },
  })));
}

// The largest swing of a channel: what the distance between two rows stands for.
function scaleOf(intervals) {
  return Math.max(...intervals.flat(2).map(Math.abs), 1e-9);
}
