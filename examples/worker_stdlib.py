"""A complete policy worker in plain Python: `python worker_stdlib.py http://127.0.0.1:8000 TOKEN AGENT`."""

import http.client
import json
import math
import sys
from urllib.parse import urlsplit

if len(sys.argv) < 4:
    sys.exit(__doc__)
url, token, agent = sys.argv[1:4]
address = urlsplit(url)
kinds = {"http": http.client.HTTPConnection, "https": http.client.HTTPSConnection}
if address.scheme not in kinds or not address.netloc:
    sys.exit(f"expected the service's address, such as http://127.0.0.1:8000, got '{url}'")
connection = kinds[address.scheme](address.netloc, timeout=150)


def post(path, body, bearer):
    """Sends one request; returns None if the answer is empty."""
    headers = {"Authorization": f"Bearer {bearer}", "Content-Type": "application/json"}
    try:
        connection.request("POST", address.path.rstrip("/") + path, json.dumps(body), headers)
        response = connection.getresponse()
        text = response.read()
    except (OSError, http.client.HTTPException) as error:
        sys.exit(f"no answer from {url}: {error!r}")
    if response.status >= 400:
        sys.exit(f"{response.status}: {text.decode()}")
    return json.loads(text) if text else None


def decide(seen):
    """Target speed [m/s] and steering [-1, 1]: towards the path 8 m ahead, slower in curves and near the goal."""
    path = seen["route"]
    x, y = path[8][:2]  # in the ego's frame, m
    bend = max(abs(point[3]) for point in path[:30])
    steering = math.atan2(2 * 2.7 * y, x * x + y * y) / 0.6  # wheelbase [m], angle at full lock [rad]
    return [min(path[0][4], math.sqrt(2 / max(bend, 0.01)), 10.0), steering]


worker = post("/v1/workers", {"agent": agent}, token)
while True:
    episode = post(f"/v1/workers/{worker['worker']}/acquire?wait=20", {}, worker["token"])
    reply = episode
    while reply and not reply.get("done"):
        actions = {ego: decide(seen) for ego, seen in reply["observations"].items()}
        step = {"tick": reply["tick"], "actions": actions}
        reply = post(f"/v1/leases/{episode['lease']}/step", step, worker["token"])
