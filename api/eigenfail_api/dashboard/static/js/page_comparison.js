// Campaigns beside each other.
import "./main.js";
import { startCharts } from "./charts.js";
import { overlay } from "./charts_comparison.js";

startCharts({ overlay });
