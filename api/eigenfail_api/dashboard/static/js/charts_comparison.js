// Several campaigns on one pair of axes: each has a colour, a shape and a dash of its own.
import { axis, compact, grid, legend, legendExcess, tip, tooltip, yAxis } from "./parts.js";
import { dash, mark, symbol } from "./theme.js";

const LEGEND_PX = 15;
const MANY = 60;

export function overlay({ x, y, look, lines }, width) {
  const top = 14 + LEGEND_PX + legendExcess(lines.map(({ name }) => name), width);
  return {
    height: 250 + top,
    grid: grid({ top: top + 8 }),
    legend: legend({ itemWidth: look === "marks" ? 12 : 28, data: lines.map(({ name }) => ({ name })) }),
    xAxis: axis(x, { scale: look === "marks", ...(look === "marks" ? {} : { min: 0 }) }),
    yAxis: yAxis(y, { min: 0 }),
    tooltip: tooltip(({ seriesName, data }) => tip(seriesName, [`${x} ${compact(data[0])}`, `${y} ${compact(data[1])}`])),
    series: lines.map((line, position) => (look === "marks" ? marks(line, position) : curve(line, position, look))),
  };
}

const points = ({ x, y }) => x.map((value, place) => [value, y[place]]);

function marks(line, position) {
  return {
    name: line.name,
    type: "scatter",
    symbol: symbol(position),
    symbolSize: 8,
    itemStyle: { color: mark(position), opacity: 0.75 },
    data: points(line),
  };
}

function curve(line, position, look) {
  return {
    name: line.name,
    type: "line",
    step: look === "steps" ? "end" : false,
    symbol: symbol(position),
    symbolSize: 7,
    showSymbol: line.x.length < MANY,
    itemStyle: { color: mark(position) },
    lineStyle: { color: mark(position), type: dash(position), width: 2 },
    data: points(line),
  };
}
