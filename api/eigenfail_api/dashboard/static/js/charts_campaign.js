// A campaign over its episodes, and its failures.
import { MANY, axis, compact, grid, legend, strokes, tip, tooltip, yAxis } from "./parts.js";
import { colour } from "./theme.js";

export function curve({ what, middle, span, rate, low, high }) {
  return {
    grid: grid(),
    xAxis: axis("Episode", { min: 0 }),
    yAxis: yAxis(`${what} [%]`, { min: 0, max: Math.max(...rate, ...high) > 80 ? 100 : null }),
    tooltip: tooltip(({ dataIndex: block }) => tip(`Episodes ${span[block]}`, [
      low[block] === null ? `${compact(rate[block])} %` : `${compact(rate[block])} % (${compact(low[block])} – ${compact(high[block])} %)`,
    ])),
    series: [
      strokes(middle.map((x, block) => [[x, low[block]], [x, high[block]]]).filter(([[, from]]) => from !== null)),
      {
        type: "line",
        data: middle.map((x, block) => [x, rate[block]]),
        symbol: "circle",
        symbolSize: 7,
        itemStyle: { color: colour("mark-1") },
        lineStyle: { color: colour("mark-1"), width: 2 },
      },
    ],
  };
}

export function robustness({ index, robustness: distance, failure, unit }) {
  const points = index.map((episode, row) => [episode, distance[row], episode]);
  const series = (name, wanted, look) => ({
    name, type: "scatter", ...MANY, data: points.filter((_, row) => failure[row] === wanted), ...look,
  });
  return {
    grid: grid(),
    legend: legend(),
    xAxis: axis("Episode", { min: 0 }),
    yAxis: yAxis(unit ? `Robustness [${unit}]` : "Robustness", { min: 0 }),
    tooltip: tooltip(({ data, seriesName }) => tip(`Episode ${data[0]}`, [seriesName, `${compact(data[1])} ${unit}`.trim()])),
    series: [
      series("safe", false, { symbol: "circle", symbolSize: 5, itemStyle: { color: colour("safe"), opacity: 0.75 } }),
      series("failure", true, { symbol: "diamond", symbolSize: 9, itemStyle: { color: colour("mark-1") } }),
    ],
  };
}

const LOOKS = {
  "planner failure": { symbol: "diamond", mark: "mark-1" },
  unavoidable: { symbol: "triangle", mark: "mark-0" },
  "not classified": { symbol: "circle", mark: "mark-7" },
};

export function likelihood({ index, likelihood: logP, severity, kind }) {
  const points = index.map((episode, row) => [logP[row], severity[row], episode]);
  const kinds = Object.keys(LOOKS).filter((name) => kind.includes(name));
  return {
    grid: grid(),
    legend: legend(),
    xAxis: axis("log p per step", { scale: true }),
    yAxis: yAxis("Severity [m²/s²]", { min: 0 }),
    tooltip: tooltip(({ data, seriesName }) => tip(`Episode ${data[2]}`, [
      seriesName, `log p per step ${compact(data[0])}`, `severity ${compact(data[1])} m²/s²`,
    ])),
    series: kinds.map((name) => ({
      name,
      type: "scatter",
      ...MANY,
      symbol: LOOKS[name].symbol,
      symbolSize: 8,
      itemStyle: { color: colour(LOOKS[name].mark), opacity: 0.8 },
      data: points.filter((_, row) => kind[row] === name),
    })),
  };
}
