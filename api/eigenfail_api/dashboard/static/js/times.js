// Times in the time zone of the browser. Pages have them in UTC, which stays as the title.
const pad = (number, digits = 2) => String(number).padStart(digits, "0");

function write(at, zone) {
  const date = [pad(at.getUTCFullYear(), 4), pad(at.getUTCMonth() + 1), pad(at.getUTCDate())].join("-");
  return `${date} ${[at.getUTCHours(), at.getUTCMinutes(), at.getUTCSeconds()].map((part) => pad(part)).join(":")} ${zone}`;
}

// By hand: the browser's formatter takes longer to begin than a chart to be drawn.
function writeLocal(at) {
  const minutes = -at.getTimezoneOffset();
  if (minutes === 0) return write(at, "UTC");
  const size = Math.abs(minutes);
  const zone = `UTC${minutes < 0 ? "−" : "+"}${pad(Math.floor(size / 60))}:${pad(size % 60)}`;
  return write(new Date(at.getTime() + 60_000 * minutes), zone);
}

function showLocally() {
  for (const element of document.querySelectorAll("time[datetime]")) {
    const at = new Date(element.dateTime);
    element.textContent = writeLocal(at);
    element.title = write(at, "UTC");
  }
}

// Parts that the page fetches later come in UTC, too.
export function showLocalTimes() {
  showLocally();
  document.addEventListener("htmx:after:swap", showLocally);
  document.getElementById("zone").textContent = "all times in the time zone of this browser";
}
