// The episodes of a campaign: a brush along an axis is a condition.
import "./main.js";
import { brushed } from "./brushes.js";
import { startCharts } from "./charts.js";
import { parallel } from "./charts_parallel.js";

startCharts({ parallel }, (chart) => chart.on("axisareaselected", (event) => brushed(chart, event)));
