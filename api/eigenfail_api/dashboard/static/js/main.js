// What every page needs: charts, buttons, the player, and the feed of events.
import { arm } from "./actions.js";
import { drawAll } from "./charts.js";
import { fetchLater } from "./later.js";
import { follow } from "./live.js";
import { startPlayers } from "./player.js";

document.documentElement.classList.add("js");
arm();
drawAll();
startPlayers();
fetchLater();
follow();
document.addEventListener("htmx:after:swap", drawAll);
