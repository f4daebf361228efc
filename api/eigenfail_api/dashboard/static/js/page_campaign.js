// One campaign.
import "./main.js";
import { startCharts } from "./charts.js";
import { curve, likelihood, robustness } from "./charts_campaign.js";
import { spending } from "./charts_spending.js";

startCharts({ curve, likelihood, robustness, spending });
