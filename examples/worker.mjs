// A complete policy worker in JavaScript: `node worker.mjs http://127.0.0.1:8000 TOKEN AGENT`.
const [address, token, agent] = process.argv.slice(2);
if (!agent) {
  console.error("usage: node worker.mjs http://127.0.0.1:8000 TOKEN AGENT");
  process.exit(1);
}
const url = address.replace(/\/+$/, "");

async function post(path, body, bearer) {
  const headers = { authorization: `Bearer ${bearer}`, "content-type": "application/json" };
  try {
    const response = await fetch(url + path, { method: "POST", headers, body: JSON.stringify(body) });
    const text = await response.text();
    if (response.ok) return text ? JSON.parse(text) : null;
    console.error(`${response.status}: ${text}`);
  } catch (error) {
    console.error(`no answer from ${url}: ${error.cause?.code ?? error}`);
  }
  process.exit(1);
}

// Target speed [m/s] and steering [-1, 1]: towards the path 8 m ahead, slower in curves.
function decide({ route }) {
  const [x, y] = route[8]; // in the ego's frame, m
  const bend = Math.max(...route.slice(0, 30).map((point) => Math.abs(point[3])));
  const steering = Math.atan2(2 * 2.7 * y, x * x + y * y) / 0.6; // wheelbase [m], angle at full lock [rad]
  return [Math.min(route[0][4], Math.sqrt(2 / Math.max(bend, 0.01)), 10), steering];
}

const worker = await post("/v1/workers", { agent }, token);
for (;;) {
  const episode = await post(`/v1/workers/${worker.worker}/acquire?wait=20`, {}, worker.token);
  for (let reply = episode; reply && !reply.done; ) {
    const actions = Object.fromEntries(Object.entries(reply.observations).map(([ego, seen]) => [ego, decide(seen)]));
    reply = await post(`/v1/leases/${episode.lease}/step`, { tick: reply.tick, actions }, worker.token);
  }
}
