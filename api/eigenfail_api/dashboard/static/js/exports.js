// Parquet is made by the service first, and fetched then.
import { tell } from "./notice.js";

const LOOK_MS = 500;
const RUNNING = "running";

export async function fetchFile(button) {
  button.disabled = true;
  try {
    tell("Creating the file …");
    const made = await finished(await asked(button.dataset.export));
    window.location.assign(`/api/v1/exports/${made.id}/file`);
  } catch (error) {
    tell(error.message);
  } finally {
    button.disabled = false;
  }
}

function asked(address) {
  const headers = { "Content-Type": "application/json" };
  return answered(fetch(address, { method: "POST", headers, body: "{}" }));
}

async function finished({ id }) {
  for (;;) {
    const made = await answered(fetch(`/api/v1/exports/${id}`));
    if (made.problem) throw new Error(`The file could not be created: ${made.problem}`);
    if (made.state !== RUNNING) return made;
    await new Promise((done) => { setTimeout(done, LOOK_MS); });
  }
}

async function answered(request) {
  const response = await request;
  const answer = await response.json();
  if (!response.ok) throw new Error([answer.detail, answer.remedy].filter(Boolean).join(" "));
  return answer;
}
