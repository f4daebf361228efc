// Strips of one episode: its noise, and quantities of its course such as distance and speed.
import { axis, channelLegend, compact, grid, tip, tooltip, yAxis } from "./parts.js";
import { colour, dash, mark } from "./theme.js";

const BAND_SIGMA = 2;

// Multiples of a step of time carry errors of rounding, which a tick would tell.
const DIGITS = 6;

// All strips have the same margins, whatever the labels of their axes: one cursor crosses them.
const strip = (more = {}) => grid({ outerBoundsMode: "none", ...more });

export function noise({ axis: name, end, time, channels }, width) {
  const { legend: above, excess } = channelLegend(Object.keys(channels), width);
  return {
    height: 220 + excess,
    grid: strip({ top: grid().top + excess }),
    legend: above,
    xAxis: axis(name, { min: 0, max: Number(end.toPrecision(DIGITS)) }),
    yAxis: yAxis("Noise [sigma]"),
    tooltip: tooltip(({ seriesName, data }) => tip(seriesName, [`${compact(data[0])}: ${compact(data[1])} sigma`])),
    series: Object.entries(channels).map(([way, z], position) => line(way, position, time, z)),
  };
}

function line(way, position, time, z) {
  return {
    name: way,
    type: "line",
    data: z.map((value, step) => [time[step], value]),
    symbol: "circle",
    symbolSize: 8,
    showSymbol: false,
    itemStyle: { color: mark(position) },
    lineStyle: { color: mark(position), type: dash(position), width: 2 },
    ...(position ? {} : { markArea: band() }),
  };
}

function band() {
  return {
    silent: true,
    itemStyle: { color: colour("band") },
    data: [[{ yAxis: -BAND_SIGMA }, { yAxis: BAND_SIGMA }]],
  };
}

export function course({ axis: name, end, time, unit, ticks: [min, max, interval], values }) {
  return {
    height: 132,
    grid: strip({ top: 12 }),
    xAxis: axis(name, { min: 0, max: Number(end.toPrecision(DIGITS)) }),
    yAxis: yAxis(`[${unit}]`, { min, max, interval }),
    tooltip: tooltip(({ data }) => tip(`${compact(data[0])} s`, [`${compact(data[1])} ${unit}`])),
    series: [{
      type: "line",
      data: values.map((value, step) => [time[step], value]),
      connectNulls: false,
      symbol: "circle",
      symbolSize: 8,
      showSymbol: false,
      itemStyle: { color: mark(0) },
      lineStyle: { color: mark(0), width: 2 },
      areaStyle: { color: colour("band") },
    }],
  };
}
