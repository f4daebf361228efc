// All campaigns, and the campaigns of a suite.
import "./main.js";
import { startCharts } from "./charts.js";
import { cost } from "./charts_cost.js";

startCharts({ cost });
