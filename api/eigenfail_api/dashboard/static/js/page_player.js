// Scenes that play: an episode, and a part of one.
import "./main.js";
import { startCharts } from "./charts.js";
import { clearance, noise } from "./charts_noise.js";
import { startPlayers } from "./player.js";

startCharts({ clearance, noise });
startPlayers();
