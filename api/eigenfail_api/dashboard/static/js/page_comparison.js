// Campaigns beside each other.
import "./main.js";
import { startCharts } from "./charts.js";
import { overlay } from "./charts_comparison.js";
import { bills } from "./charts_spending.js";

startCharts({ bills, overlay });
