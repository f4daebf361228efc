// What PCA and K-means found.
import { axis, compact, grid, legend, tip, tooltip, yAxis } from "./parts.js";
import { colour, dash, mark, symbol } from "./theme.js";

const AXES = ["longitudinal", "lateral"];

export function eigenfailures(values) {
  const modes = values.longitudinal.map((_, mode) => `mode ${mode + 1}`);
  return {
    height: 380,
    legend: legend({ data: modes, itemWidth: 30 }),
    grid: [grid({ bottom: "54%" }), grid({ top: "54%" })],
    xAxis: AXES.map((_, panel) => axis(panel ? "Step" : "", { gridIndex: panel })),
    yAxis: AXES.map((name, panel) => yAxis(`${name} [sigma]`, { gridIndex: panel })),
    tooltip: tooltip(({ seriesName, data }) => tip(seriesName, [`step ${data[0]}: ${compact(data[1])} sigma`])),
    series: [...AXES.flatMap((name, panel) => values[name].map((z, mode) => ({
      name: modes[mode],
      type: "line",
      xAxisIndex: panel,
      yAxisIndex: panel,
      data: z.map((value, step) => [step, value]),
      symbol: "circle",
      symbolSize: 8,
      showSymbol: false,
      itemStyle: { color: mark(mode) },
      lineStyle: { color: mark(mode), type: dash(mode), width: 2 },
    }))), ...AXES.flatMap((name, panel) => bands(values.bands?.[name] ?? [], modes, panel))],
  };
}

// A band is drawn as an unseen line with an area stacked upon it; the legend hides it with its mode.
function bands(limits, modes, panel) {
  return limits.flatMap(([low, high], mode) => [low, high.map((value, step) => value - low[step])].map((side, upper) => ({
    name: modes[mode],
    type: "line",
    xAxisIndex: panel,
    yAxisIndex: panel,
    stack: `band ${panel} ${mode}`,
    stackStrategy: "all",
    data: side.map((value, step) => [step, value]),
    symbol: "none",
    silent: true,
    z: 1,
    lineStyle: { opacity: 0 },
    itemStyle: { color: mark(mode) },
    ...(upper ? { areaStyle: { color: mark(mode), opacity: 0.13 } } : {}),
  })));
}

export function scores({ episode, mode, x, y, centres }) {
  const series = centres.map((_, number) => ({
    name: `mode ${number + 1}`,
    type: "scatter",
    symbol: symbol(number),
    symbolSize: 8,
    itemStyle: { color: mark(number), opacity: 0.8 },
    data: episode
      .map((address, row) => ({ value: [x[row], y[row]], link: address.replace("/", "/episodes/"), address }))
      .filter((_, row) => mode[row] === number),
  }));
  const middles = {
    name: "centre",
    type: "scatter",
    symbol: "path://M-1,-7 L1,-7 L1,-1 L7,-1 L7,1 L1,1 L1,7 L-1,7 L-1,1 L-7,1 L-7,-1 L-1,-1 Z",
    symbolSize: 16,
    itemStyle: { color: colour("ink") },
    data: centres.map((centre) => ({ value: centre })),
  };
  return {
    height: 380,
    grid: grid(),
    legend: legend(),
    xAxis: axis("First score", { scale: true }),
    yAxis: yAxis("Second score", { scale: true }),
    tooltip: tooltip(({ data, seriesName }) => tip(seriesName, data.address ? [`campaign/episode ${data.address}`] : [])),
    series: [...series, middles],
  };
}

export function explained({ share, cumulated }) {
  return {
    grid: grid(),
    legend: legend(),
    xAxis: axis("Component", { type: "category", data: share.map((_, place) => place + 1) }),
    yAxis: yAxis("Variance [%]", { min: 0, max: 100 }),
    tooltip: tooltip(({ seriesName, name, value }) => tip(`Component ${name}`, [`${seriesName} ${compact(value)} %`])),
    series: [
      { name: "share", type: "bar", barMaxWidth: 44, data: share, itemStyle: { color: mark(0) } },
      { name: "cumulated", type: "line", data: cumulated, symbolSize: 7, itemStyle: { color: mark(1) } },
    ],
  };
}

export function influence(values) {
  return {
    grid: grid(),
    legend: legend({ itemWidth: 30 }),
    xAxis: axis("Step"),
    yAxis: yAxis("Influence", { min: 0 }),
    tooltip: tooltip(({ seriesName, data }) => tip(seriesName, [`step ${data[0]}: ${compact(data[1])}`, data[2] ?? ""])),
    series: [...AXES.map((name, position) => ({
      name,
      type: "line",
      data: values[name].map((value, step) => [step, value]),
      symbol: "circle",
      symbolSize: 8,
      showSymbol: false,
      itemStyle: { color: mark(position) },
      lineStyle: { color: mark(position), type: dash(position), width: 2 },
    })), ...AXES.map((name, position) => moments(name, position, values))],
  };
}

function moments(name, position, values) {
  return {
    name,
    type: "scatter",
    symbol: symbol(position + 2),
    symbolSize: 11,
    itemStyle: { color: mark(position) },
    data: values.moments
      .filter((moment) => moment.axis === name)
      .map((moment) => [moment.step, values[name][moment.step], moment.time]),
  };
}
