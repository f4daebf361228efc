// One line at the foot of the page, for what went wrong or was done.
const SHOWN_MS = 8000;
let timer;

export function tell(text) {
  const notice = document.getElementById("notice");
  notice.textContent = text;
  notice.hidden = false;
  clearTimeout(timer);
  timer = setTimeout(() => { notice.hidden = true; }, SHOWN_MS);
}
