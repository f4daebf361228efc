// What every page needs: buttons, parts that come later, and the feed of events.
import { arm, armCopies } from "./actions.js";
import { fetchLater, follow } from "./live.js";
import { armNotifications } from "./notifications.js";
import { showLocalTimes } from "./times.js";

document.documentElement.classList.add("js");
arm();
armCopies();
fetchLater();
follow();
showLocalTimes();
armNotifications();
// A swap replaces a part of the page: the title of the document that the part came from is not its title.
document.addEventListener("htmx:before:swap", ({ detail }) => { detail.ctx.title = null; });
// As on other sites, / goes to the search, unless it is typed into a field.
document.addEventListener("keydown", (event) => {
  if (event.key !== "/" || event.ctrlKey || event.metaKey || event.altKey) return;
  if (event.target.closest("input, textarea, select, [contenteditable]")) return;
  event.preventDefault();
  document.getElementById("search").focus();
});
// Its script comes with the first click: most pages are read without one.
document.addEventListener("click", ({ target }) => {
  const term = target.closest("[data-term]");
  if (term) import("./definitions.js").then(({ define }) => define(term));
});
