"""Worlds that were live when their service was killed: one that was over has its record."""

from __future__ import annotations

import signal
from pathlib import Path

from dohyo.evaluation.records.store import read_whole_record
from tests.service.serving import serving
from tests.service.worlds.clients import Client, scenario

ALONE = {"scenario": scenario(1).model_dump(mode="json"), "stays": True, "undriven": "out"}


def over(client: Client, *, record: bool, resets: int = 0) -> str:
    """A world whose ego has left the road, and that stays."""
    world = client.world(**ALONE, record=record)
    client.order(world, "pause")
    client.order(world, "step", {"ticks": 3})
    client.until(world, lambda found: found["status"] == "over")
    for seed in range(resets):
        client.order(world, "reset", {"seed": seed})
    return world


def test_a_world_that_was_over_keeps_its_record_through_kill_9(tmp_path: Path) -> None:
    with serving(tmp_path / "data") as first:
        before = Client(first)
        whole, unwritten = over(before, record=True), over(before, record=True, resets=1)
        assert before.send("GET", f"/v1/worlds/{whole}/record").json()["detail"].startswith("the world is live")
        assert first.end(signal.SIGKILL) == -signal.SIGKILL
    with serving(tmp_path / "data") as second:
        after = Client(second, before.token)
        found = after.get(whole)
        assert (found["status"], found["reason"]) == ("done", None)
        answer = after.send("GET", f"/v1/worlds/{whole}/record")
        record = read_whole_record(tmp_path / "data" / "worlds" / f"{whole}.json")
        assert (record.record_hash, record.ticks) == (found["record_hash"], found["tick"])
        assert answer.json()["record_hash"] == record.record_hash
        assert after.get(unwritten)["status"] == "failed", "the run after its reset has no record"
        answer = after.send("GET", f"/v1/worlds/{unwritten}/record")
        assert (answer.status_code, "has failed, and has no record" in answer.json()["detail"]) == (409, True)
