// Scenes that play: an episode, and a part of one.
import "./main.js";
import { startCharts } from "./charts.js";
import { course, noise } from "./charts_noise.js";
import { startPlayers } from "./player.js";

startCharts({ course, noise });
startPlayers();
