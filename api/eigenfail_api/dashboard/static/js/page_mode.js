// The failures of a mode, which play side by side and over each other.
import "./main.js";
import { overlay } from "./overlay.js";
import { startPlayers } from "./player.js";

startPlayers({ overlay });

document.querySelector("[data-play-all]")?.addEventListener("click", () => {
  const stages = [...document.querySelectorAll("[data-films] [data-player]")];
  for (const stage of stages) rewind(stage);
  for (const stage of stages) stage.querySelector("[data-play]").click();
});

// A scene that plays already stops, at its first step.
function rewind(stage) {
  const scrub = stage.querySelector("[data-scrub]");
  scrub.value = 0;
  scrub.dispatchEvent(new Event("input"));
}
