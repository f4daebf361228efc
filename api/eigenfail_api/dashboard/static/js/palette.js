// Colours for what is drawn many times a second: looked up once for each theme.
import { colour, onThemeChange } from "./theme.js";

const NAMES = {
  bad: "bad", ego: "mark-0", ink: "ink", muted: "muted", other: "mark-1",
  path: "mark-2", road: "road", seen: "mark-3", surface: "surface",
};

let kept = null;

onThemeChange(() => { kept = null; });

export function palette() {
  kept ??= Object.fromEntries(Object.entries(NAMES).map(([name, variable]) => [name, colour(variable)]));
  return kept;
}
