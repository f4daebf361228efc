// What every page needs: buttons, parts that come later, and the feed of events.
import { arm } from "./actions.js";
import { armCopies } from "./copy.js";
import { fetchLater } from "./later.js";
import { follow } from "./live.js";

document.documentElement.classList.add("js");
arm();
armCopies();
fetchLater();
follow();
