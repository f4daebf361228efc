// The modes of failures, and the episodes that stand for them.
import "./main.js";
import { startCharts } from "./charts.js";
import { eigenfailures, explained, influence, scores } from "./charts_analysis.js";
import { behaviour } from "./charts_behaviour.js";
import { course, noise } from "./charts_noise.js";
import { training } from "./charts_training.js";
import { startPlayers } from "./player.js";

startCharts({ behaviour, course, eigenfailures, explained, influence, noise, scores, training });
startPlayers();
