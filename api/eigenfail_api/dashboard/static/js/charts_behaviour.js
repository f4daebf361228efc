// What the ego did in the failures of each mode: a panel for each, all of one scale.
import { columnsOf, heightOf, placeOf, rangeOf } from "./panels.js";
import { axis, capitalized, compact, tip, tooltip, yAxis } from "./parts.js";
import { mark } from "./theme.js";

export function behaviour({ noun, event, times, modes }, width) {
  const columns = columnsOf(modes.length, width);
  const [min, max] = rangeOf(modes.flatMap(({ mean, members }) => [mean, ...members].flat()));
  return {
    height: heightOf(modes.length, columns),
    grid: modes.map((_, panel) => placeOf(panel, columns)),
    xAxis: modes.map((_, panel) => axis(`Time from the ${event} [s]`, { gridIndex: panel, min: "dataMin", max: "dataMax" })),
    yAxis: modes.map((_, panel) => yAxis(`${capitalized(noun)} ${panel + 1} [m/s²]`, { gridIndex: panel, min, max })),
    tooltip: tooltip(({ seriesName, data }) => tip(seriesName, [`${compact(data[0])} s: ${compact(data[1])} m/s²`])),
    series: modes.flatMap(({ mean, members }, panel) => [
      ...members.map((values) => line(`failure of ${noun} ${panel + 1}`, panel, times, values, { width: 1, opacity: 0.3 })),
      line(`${noun} ${panel + 1}, mean`, panel, times, mean, { width: 3 }),
    ]),
  };
}

function line(name, panel, times, values, style) {
  return {
    name,
    type: "line",
    xAxisIndex: panel,
    yAxisIndex: panel,
    data: values.map((value, step) => [times[step], value]),
    symbol: "circle",
    symbolSize: 6,
    showSymbol: false,
    z: style.opacity ? 1 : 2,
    itemStyle: { color: mark(panel) },
    lineStyle: { color: mark(panel), ...style },
  };
}
