"""An agent sees the same through a worker as locally: the same types and numbers, in arrays that it may write to."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np

from dohyo.evaluation.agent import Agent, AgentSpec, Mission, Observation, make_agent
from dohyo.evaluation.episode.runner import drive_episode
from dohyo.service.client.worker import Driver, work
from dohyo.service.client.worker_session import WorkerSession
from tests.service.served import Service, info_of, short

LOOKS = "tests.service.workers.test_pictures:Looks"


class Looks(Agent):
    """Drives along, and notes what it sees; a picture that is not in bytes would double its speed.

    Attributes:
        notes: One line for each array.
    """

    spec = AgentSpec(name="looks", track="sensors", sensors=("camera_64", "speedometer"), control="lane_command")

    def __init__(self, notes: str) -> None:
        self.notes = Path(notes)

    def reset(self, mission: Mission, seed: int) -> None:
        self.notes.write_text("")

    def act(self, observation: Observation) -> np.ndarray:
        with self.notes.open("a") as file:
            for name, array in observation.items():
                digest = hashlib.sha256(array.tobytes()).hexdigest()
                file.write(f"{name} {array.dtype} {array.shape} {array.flags.writeable} {digest}\n")
        return np.array([6.0 if observation["camera_64"].dtype == np.uint8 else 12.0, 0.0])


def test_a_picture_is_in_bytes_through_a_worker_too(running_service: Service, tmp_path: Path) -> None:
    here, there = ({"notes": str(tmp_path / name)} for name in ("here", "there"))
    (scenario,) = short().scenarios([0])
    _, driven = drive_episode(scenario, {scenario.missions[0].name: make_agent(LOOKS, here)})
    order = running_service.submit(info_of(LOOKS, **there), short())
    work(WorkerSession(running_service.url, running_service.token, "looks"), Driver(LOOKS, there), episodes=1)
    assert running_service.record(order).trajectory_sha256 == driven.sha256()
    assert Path(there["notes"]).read_text() == Path(here["notes"]).read_text()
    assert Path(here["notes"]).read_text().startswith("camera_64 uint8 (3, 64, 64) True ")
