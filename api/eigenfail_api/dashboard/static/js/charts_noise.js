// The noise of one episode; its cursor follows the player.
import { axis, compact, grid, legend, tip, tooltip, yAxis } from "./parts.js";
import { colour, dash, mark } from "./theme.js";

const AXES = ["longitudinal", "lateral"];
const BAND_SIGMA = 2;

export function noise({ axis: name, time, ...values }) {
  return {
    height: 320,
    grid: grid(),
    legend: legend({ itemWidth: 30 }),
    xAxis: axis(name, { min: 0, max: "dataMax" }),
    yAxis: yAxis("Noise [sigma]"),
    tooltip: tooltip(({ seriesName, data }) => tip(seriesName, [`${compact(data[0])}: ${compact(data[1])} sigma`])),
    series: [...AXES.map((way, position) => line(way, position, time, values[way])), { id: "cursor", type: "line", data: [] }],
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

document.addEventListener("eigenfail:time", ({ detail }) => {
  const plot = document.querySelector("[data-chart=noise] .plot");
  const chart = plot && window.echarts.getInstanceByDom(plot);
  const markLine = {
    silent: true,
    symbol: "none",
    label: { show: false },
    lineStyle: { color: colour("ink"), type: "solid", width: 1 },
    data: [{ xAxis: detail.time }],
  };
  chart?.setOption({ series: [{ id: "cursor", markLine }] });
});
