// Strips of one episode: its noise, and quantities of its course such as distance and speed.
import { axis, compact, grid, legend, tip, tooltip, yAxis } from "./parts.js";
import { colour, dash, mark } from "./theme.js";

const BAND_SIGMA = 2;

// Multiples of a step of time carry errors of rounding, which a tick would tell.
const DIGITS = 6;

export function noise({ axis: name, end, time, channels }) {
  return {
    height: 220,
    grid: grid(),
    legend: legend({ itemWidth: 30 }),
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

export function course({ axis: name, end, time, unit, values }) {
  return {
    height: 132,
    grid: grid({ top: 12 }),
    xAxis: axis(name, { min: 0, max: Number(end.toPrecision(DIGITS)) }),
    yAxis: yAxis(`[${unit}]`, { splitNumber: 3 }),
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
