// What the ego did in the failures of each mode: a panel for each, all of one scale.
import { axis, compact, tip, tooltip, yAxis } from "./parts.js";
import { mark } from "./theme.js";

const NARROW_PX = 620;
const PANEL_PX = 210;
const TOP_PX = 26;
const BOTTOM_PX = 56;

export function behaviour({ event, times, modes }, width) {
  const columns = width < NARROW_PX || modes.length < 2 ? 1 : 2;
  const [min, max] = rangeOf(modes);
  return {
    height: PANEL_PX * Math.ceil(modes.length / columns),
    grid: modes.map((_, panel) => place(panel, columns)),
    xAxis: modes.map((_, panel) => axis(`Time from the ${event} [s]`, { gridIndex: panel, min: "dataMin", max: "dataMax" })),
    yAxis: modes.map((_, panel) => yAxis(`Mode ${panel + 1} [m/s²]`, { gridIndex: panel, min, max })),
    tooltip: tooltip(({ seriesName, data }) => tip(seriesName, [`${compact(data[0])} s: ${compact(data[1])} m/s²`])),
    series: modes.flatMap(({ mean, members }, panel) => [
      ...members.map((values) => line(`failure of mode ${panel + 1}`, panel, times, values, { width: 1, opacity: 0.3 })),
      line(`mode ${panel + 1}, mean`, panel, times, mean, { width: 3 }),
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

function place(panel, columns) {
  const row = Math.floor(panel / columns);
  const across = columns === 1 ? { left: 74, right: 12 } : { left: panel % columns ? "58%" : 74, width: "36%" };
  return { ...across, top: TOP_PX + row * PANEL_PX, height: PANEL_PX - TOP_PX - BOTTOM_PX };
}

function rangeOf(modes) {
  const values = modes.flatMap(({ mean, members }) => [mean, ...members].flat());
  return [Math.floor(Math.min(0, ...values)), Math.ceil(Math.max(0, ...values))];
}
