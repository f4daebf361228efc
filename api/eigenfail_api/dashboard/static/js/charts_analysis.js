// What PCA and K-means found.
import { columnsOf, heightOf, placeOf, rangeOf } from "./panels.js";
import { axis, capitalized, channelLegend, compact, grid, legend, legendExcess, tip, tooltip, yAxis } from "./parts.js";
import { colour, dash, mark, symbol } from "./theme.js";

const LEGEND_PX = 30;
const SCORES_PX = 380;
const INFLUENCE_PX = 272;

// Bands of more channels would hide each other.
const MOST_BANDS = 2;

export function eigenfailures({ noun, channels, bands: limits }, width) {
  const names = Object.keys(channels);
  const modes = channels[names[0]].map((_, mode) => mode);
  const columns = columnsOf(modes.length, width);
  const drawn = names.length > MOST_BANDS ? {} : limits;
  const shown = Object.values(drawn).flat(3).concat(Object.values(channels).flat(2));
  const [min, max] = rangeOf(shown.filter((value) => value !== null));
  const { legend: above, excess } = channelLegend(names, width);
  const head = LEGEND_PX + excess;
  return {
    height: heightOf(modes.length, columns, head),
    legend: above,
    grid: modes.map((mode) => placeOf(mode, columns, head)),
    xAxis: modes.map((mode) => axis("Step", { gridIndex: mode })),
    yAxis: modes.map((mode) => yAxis(`${capitalized(noun)} ${mode + 1} [sigma]`, { gridIndex: mode, min, max })),
    tooltip: tooltip(({ seriesName, data }) => tip(seriesName, [`step ${data[0]}: ${compact(data[1])} sigma`])),
    series: names.flatMap((name, position) => modes.flatMap((mode) => [
      line(name, position, mode, channels[name][mode]),
      ...band(name, position, mode, drawn[name]?.[mode]),
    ])),
  };
}

function line(name, position, mode, z) {
  return {
    name,
    type: "line",
    xAxisIndex: mode,
    yAxisIndex: mode,
    data: z.map((value, step) => [step, value]),
    symbol: "circle",
    symbolSize: 8,
    showSymbol: false,
    itemStyle: { color: mark(position) },
    lineStyle: { color: mark(position), type: dash(position), width: 2 },
  };
}

// A band is drawn as an unseen line with an area stacked upon it; the legend hides it with its channel.
function band(name, position, mode, limits) {
  if (!limits) return [];
  const [low, high] = limits;
  return [low, high.map((value, step) => value - low[step])].map((side, upper) => ({
    name,
    type: "line",
    xAxisIndex: mode,
    yAxisIndex: mode,
    stack: `band ${mode} ${position}`,
    stackStrategy: "all",
    data: side.map((value, step) => [step, value]),
    symbol: "none",
    silent: true,
    z: 1,
    lineStyle: { opacity: 0 },
    itemStyle: { color: mark(position) },
    ...(upper ? { areaStyle: { color: mark(position), opacity: 0.13 } } : {}),
  }));
}

export function scores({ noun, episode, mode, x, y, centres }, width) {
  const series = centres.map((_, number) => ({
    name: `${noun} ${number + 1}`,
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
  const excess = legendExcess([...series, middles].map(({ name }) => name), width);
  return {
    height: SCORES_PX + excess,
    grid: grid({ top: grid().top + excess }),
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

export function influence({ channels, moments: marked }, width) {
  const lines = Object.entries(channels);
  const { legend: above, excess } = channelLegend(Object.keys(channels), width);
  return {
    height: INFLUENCE_PX + excess,
    grid: grid({ top: grid().top + excess }),
    legend: above,
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
