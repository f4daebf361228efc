// What had been found once so much was spent.
import { axis, compact, grid, legend, tip, tooltip, yAxis } from "./parts.js";
import { dash, mark, symbol } from "./theme.js";

const WHOLE = { min: 0, minInterval: 1 };

export function spending({ usd, failures, modes }) {
  return {
    grid: grid({ right: modes ? 52 : 18 }),
    legend: legend({ itemWidth: 30 }),
    xAxis: axis("USD", { min: 0 }),
    yAxis: [
      yAxis("Failures", WHOLE),
      ...(modes ? [yAxis("Distinct modes", { ...WHOLE, max: ({ max }) => max + 1, nameGap: 30, splitLine: { show: false } })] : []),
    ],
    tooltip: tooltip(({ seriesName, data }) => tip(`${compact(data[0])} USD`, [`${compact(data[1])} ${seriesName}`])),
    series: [
      steps("failures", usd, failures, 0),
      ...(modes ? [{ ...steps("modes", usd, modes, 1), yAxisIndex: 1 }] : []),
    ],
  };
}

function steps(name, usd, counts, position) {
  return {
    name,
    type: "line",
    step: "end",
    data: usd.map((sum, point) => [sum, counts[point]]),
    symbol: symbol(position),
    symbolSize: 6,
    showSymbol: usd.length < 60,
    itemStyle: { color: mark(position) },
    lineStyle: { color: mark(position), type: dash(position), width: 2 },
  };
}
