// What PCA and K-means found.
import { axis, compact, grid, legend, tip, tooltip, yAxis } from "./parts.js";
import { colour, dash, mark, symbol } from "./theme.js";

const PANEL_PX = 190;
const SINGLE_PX = 240;

export function eigenfailures({ channels, bands: limits }) {
  const names = Object.keys(channels);
  const modes = channels[names[0]].map((_, mode) => `mode ${mode + 1}`);
  const last = names.length - 1;
  return {
    height: last ? PANEL_PX * names.length : SINGLE_PX,
    legend: legend({ data: modes, itemWidth: 30 }),
    grid: names.map((_, panel) => grid(place(panel, names.length))),
    xAxis: names.map((_, panel) => axis(panel === last ? "Step" : "", { gridIndex: panel })),
    yAxis: names.map((name, panel) => yAxis(`${name} [sigma]`, { gridIndex: panel })),
    tooltip: tooltip(({ seriesName, data }) => tip(seriesName, [`step ${data[0]}: ${compact(data[1])} sigma`])),
    series: [...names.flatMap((name, panel) => channels[name].map((z, mode) => ({
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
    }))), ...names.flatMap((name, panel) => bands(limits?.[name] ?? [], modes, panel))],
  };
}

// Panels stand one below the other; the first leaves room for the legend, the last for its name.
function place(panel, panels) {
  const upTo = (count) => `${(100 * count + 8) / panels}%`;
  return {
    ...(panel ? { top: upTo(panel) } : {}),
    ...(panel < panels - 1 ? { bottom: upTo(panels - 1 - panel) } : {}),
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

export function influence({ channels, moments: marked }) {
  const lines = Object.entries(channels);
  return {
    grid: grid(),
    legend: legend({ itemWidth: 30 }),
    xAxis: axis("Step"),
    yAxis: yAxis("Influence", { min: 0 }),
    tooltip: tooltip(({ seriesName, data }) => tip(seriesName, [`step ${data[0]}: ${compact(data[1])}`, data[2] ?? ""])),
    series: [...lines.map(([name, weights], position) => ({
      name,
      type: "line",
      data: weights.map((value, step) => [step, value]),
      symbol: "circle",
      symbolSize: 8,
      showSymbol: false,
      itemStyle: { color: mark(position) },
      lineStyle: { color: mark(position), type: dash(position), width: 2 },
    })), ...lines.map(([name, weights], position) => moments(name, position, weights, marked))],
  };
}

function moments(name, position, weights, marked) {
  return {
    name,
    type: "scatter",
    symbol: symbol(position + 2),
    symbolSize: 11,
    itemStyle: { color: mark(position) },
    data: marked
      .filter((moment) => moment.axis === name)
      .map((moment) => [moment.step, weights[moment.step], moment.time]),
  };
}
