"""Processes that drive episodes: no secret of the service, no network, and no model outlives its deadline in them."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from dohyo.sumo_networks.freeway.days import drive_day
from dohyo.sumo_networks.freeway.scenario import FreewayScenario
from tests.service.conftest import MakeService
from tests.service.served import info_of, short
from tests.service.tables import sqlite_with_tables

AUTOPILOT = "dohyo.agents.experts.autopilot:Autopilot"


def test_an_episode_process_has_no_secret_and_a_filter(
    make_service: MakeService, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from dohyo.service.submissions.model import AgentKind

    monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", "secret")
    service = make_service(processes=1, database=sqlite_with_tables(tmp_path / "secret.db"))
    service.start()
    service.hashes(service.submit(info_of(AUTOPILOT), short(), kind=AgentKind.BUILTIN))
    (process,) = service.episode_processes()
    environment = Path(f"/proc/{process}/environ").read_bytes()
    names = {entry.partition(b"=")[0].decode() for entry in environment.split(b"\0") if entry}
    assert b"secret" not in environment
    assert {name for name in names if name.startswith("DOHYO_")} == {"DOHYO_HOME", "DOHYO_POLICIES"}
    status = Path(f"/proc/{process}/status").read_text()
    assert "Seccomp:\t2" in status
    assert "NoNewPrivs:\t1" in status


PROGRAM = """if True:
    import os, socket, sys, time
    import numpy as np
    from dohyo.service.confinement.rights import confine_episodes
    from dohyo.service.policies.interface import Tensor
    from dohyo.service.policies.limits import PolicyLimits
    from dohyo.service.policies.sandbox import Sandbox
    from dohyo.sumo_networks.errors import AgentTimeoutError
    from tests.service.policies import models

    confine_episodes()
    try:
        socket.socket()
        sys.exit("a socket was opened")
    except PermissionError:
        pass
    try:
        os.kill(os.getppid(), 0)
        sys.exit("a signal was sent")
    except PermissionError:
        pass
    limits = PolicyLimits(decision_s=5.0)
    model = models.triggered(models.endless()).SerializeToString()
    sandbox = Sandbox(model, (Tensor("speedometer", (2,), "float32"),), limits, 0)
    assert sandbox.decide({"speedometer": np.array([1.0, 0.5], np.float32)}).tolist() == [1.0, 0.5]
    try:
        sandbox.decide({"speedometer": np.array([9.0, 0.5], np.float32)})
        sys.exit("an endless decision ended")
    except AgentTimeoutError:
        pass
    assert not os.path.exists(f"/proc/{sandbox.pid}")
"""


def test_a_model_in_an_episode_process_is_ended_at_its_deadline() -> None:
    done = subprocess.run([sys.executable, "-c", PROGRAM], capture_output=True, text=True, check=False, timeout=300)
    assert done.returncode == 0, done.stderr


MINUTE = FreewayScenario(seed=3, start_s=6 * 3600, duration_s=60.0, warm_up_s=60.0)
QUEUES = f"""if True:
    from dohyo.service.confinement.rights import confine_episodes
    from dohyo.sumo_networks.freeway.days import drive_day
    from dohyo.sumo_networks.freeway.scenario import FreewayScenario

    confine_episodes()
    shares = []
    day = drive_day(FreewayScenario.model_validate_json({MINUTE.model_dump_json()!r}), "meso", shares.append)
    print(shares[-1], day.truth.speed_mps.tobytes().hex())
    try:
        drive_day(FreewayScenario(network="nowhere", seed=3, start_s=0.0, duration_s=60.0), "meso")
    except Exception as error:
        print(error)
"""


def test_an_episode_process_drives_days_of_queues_as_any_other() -> None:
    """The simulation has a process of its own, which is started without a socket and ended without a signal."""
    done = subprocess.run([sys.executable, "-c", QUEUES], capture_output=True, text=True, check=False, timeout=300)
    assert done.returncode == 0, done.stderr
    day, failure = done.stdout.splitlines()
    assert day == f"1.0 {drive_day(MINUTE, 'meso').truth.speed_mps.tobytes().hex()}"
    assert "no network named 'nowhere'" in failure
