// Keys of the players: of the one that has the focus; of the main one where nothing has it.
const MANY = 10;
const FIELDS = "select, textarea, input:not([type=range])";

const ACTIONS = {
  ArrowLeft: (player, step) => player.goBy(-step),
  ArrowRight: (player, step) => player.goBy(step),
  Home: (player) => player.goTo(0),
  End: (player) => player.goTo(player.last),
  " ": (player) => player.toggle(),
};
// Without a focus these move the page.
const FOCUSED = ["Home", "End"];

export function armKeys(playerOf, main) {
  document.addEventListener("keydown", (event) => {
    const action = ACTIONS[event.key];
    if (!action || event.ctrlKey || event.altKey || event.metaKey || event.target.matches(FIELDS)) return;
    if (event.key === " " && event.target.matches("button, a, summary")) return;
    const player = wanted(event, playerOf, main);
    if (!player) return;
    event.preventDefault();
    action(player, event.shiftKey ? MANY : 1);
  });
}

function wanted({ key, target }, playerOf, main) {
  const stage = target.closest("[data-player]");
  if (stage) return playerOf(stage);
  return target === document.body && !FOCUSED.includes(key) ? main() : null;
}
