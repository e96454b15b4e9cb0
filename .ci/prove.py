"""Tries the image from inside, as its default user and without network: `python prove.py '["dohyo", "serve"]' '[...]'`.

`.ci/image` runs it with two lists in JSON: the image's command and its health check. The first failure ends it.
"""

from __future__ import annotations

import importlib
import importlib.util
import json
import os
import pkgutil
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

TOOLS = ("cc", "gcc", "g++", "clang", "ld", "strip", "make", "pip", "pip3", "git", "curl")
TOOL_MODULES = ("pip", "setuptools", "wheel", "pytest", "ruff", "mypy", "sphinx", "playwright")
LAZY_MODULES = ("torch.utils.tensorboard",)
"""Modules that dohyo imports inside functions, and that lost neighbours on the way into the image."""
NOT_ALONE = "dohyo.service.database.migrations.env"
"""The one module that only Alembic can import."""

PATIENCE_S = 180.0
STREETS = """<osm version="0.6">
  <node id="1" lat="52.5000" lon="13.4000"/><node id="2" lat="52.5000" lon="13.4030"/>
  <node id="3" lat="52.5000" lon="13.4060"/><node id="4" lat="52.4980" lon="13.4030"/>
  <node id="5" lat="52.5020" lon="13.4030"/>
  <way id="1"><nd ref="1"/><nd ref="2"/><nd ref="3"/><tag k="highway" v="primary"/><tag k="lanes" v="2"/></way>
  <way id="2"><nd ref="4"/><nd ref="2"/><nd ref="5"/><tag k="highway" v="residential"/></way>
</osm>
"""


def main() -> None:
    """Proves one thing after the other."""
    command, health = (json.loads(one) for one in sys.argv[1:3])
    prove_user_and_tools()
    prove_modules()
    prove_service(command, health)
    prove_demo()
    for agent in ("ghrl", "mbappe"):  # learned networks, in options' policies and in a tree search
        prove_drives(agent, "--seeds", "0", "--sample", "1")
    prove_import()


def prove_user_and_tools() -> None:
    """The user is not root, owns the volume and cannot change the installation; nothing is there to build with."""
    check(os.getuid() != 0, f"the default user is {os.getuid()}, and owns {os.environ['DOHYO_DATA']}")
    check(os.access(os.environ["DOHYO_DATA"], os.W_OK), "the volume is writable")
    check(not os.access(sys.prefix, os.W_OK), "the installation is not")
    found = [tool for tool in TOOLS if shutil.which(tool)]
    found += [module for module in TOOL_MODULES if importlib.util.find_spec(module)]
    check(not found, f"no tools of development{': found ' + ', '.join(found) if found else ''}")


def prove_modules() -> None:
    """Every module of dohyo is imported, so that none misses a library."""
    import dohyo

    names = [one.name for one in pkgutil.walk_packages(dohyo.__path__, "dohyo.") if not one.name.endswith("__main__")]
    names.remove(NOT_ALONE)
    for name in (*names, *LAZY_MODULES):
        importlib.import_module(name)
    check(len(names) > 500, f"{len(names)} modules are imported")


def prove_service(command: Sequence[str], health: Sequence[str]) -> None:
    """The default command serves and is healthy, one evaluation is ordered and finishes, and SIGTERM ends it."""
    with (
        Path("service.log").open("w") as log,
        subprocess.Popen(command, stdout=subprocess.PIPE, stderr=log, text=True) as service,
    ):
        try:
            assert service.stdout is not None
            address = service.stdout.readline().strip()
            token = service.stdout.readline().rpartition(" ")[2].strip()
            check(bool(token), f"{' '.join(command)} says '{address}' and a token")
            prove_health(health, service)
            os.environ["DOHYO_TOKEN"] = token
            os.environ["DOHYO_SERVER"] = f"http://127.0.0.1:{os.environ['DOHYO_PORT']}"
            prove_evaluation()
        finally:
            service.send_signal(signal.SIGTERM)
    check(service.returncode == 0, "the service ends at SIGTERM")
    record = min(Path("fetched/records").glob("*.json"))
    run("dohyo", "verify", str(record))  # drives again, to the same hash


def prove_health(health: Sequence[str], service: subprocess.Popen[str]) -> None:
    """The health check succeeds within some time, and fails where nothing answers."""
    began = time.monotonic()
    while not healthy(health):
        if service.poll() is not None or time.monotonic() - began > PATIENCE_S:
            check(False, "the service becomes healthy")
        time.sleep(1.0)
    check(True, f"healthy {time.monotonic() - began:.0f} s after the start")
    check(not healthy(health, DOHYO_PORT="9"), "unhealthy where no service is")


def healthy(health: Sequence[str], **variables: str) -> bool:
    """What the image's health check says, with other variables."""
    return not subprocess.run(
        health, check=False, stderr=subprocess.DEVNULL, env={**os.environ, **variables}
    ).returncode


def prove_evaluation() -> None:
    """An agent is submitted, drives over REST, and its records arrive."""
    run("dohyo", "submit", "proof", "--builtin", "autopilot")
    run("dohyo", "evaluations", "start", "proof", "quickstart", "--seeds", "0", "--watch")
    (evaluation,) = json.loads(run("dohyo", "evaluations", "list", "--json"))
    check(evaluation["status"] == "done", f"an evaluation over REST is {evaluation['status']}")
    run("dohyo", "evaluations", "fetch", evaluation["id"], "--out", "fetched")


def prove_demo() -> None:
    """What compose.yaml runs as `demo`: two agents and their report."""
    for agent in ("autopilot", "reckless"):
        prove_drives(agent, "--out", f"out/{agent}")
    run("dohyo", "report", "out/autopilot", "out/reckless", "--out", "out/report.html")
    report = Path("out/report.html").read_text(encoding="utf-8")
    check("plotly" in report.lower() and len(report) > 1e6, f"report.html has {len(report) / 1e6:.1f} MB")


def prove_drives(agent: str, *options: str) -> None:
    """An agent drives, and never fails as a program."""
    said = json.loads(run("dohyo", "evaluate", "--agent", agent, "--benchmark", "quickstart", *options, "--json"))
    failed = [drive["failure"] for drive in said["drives"] if drive["failure"]]
    check(bool(said["drives"]) and not failed, f"{len(said['drives'])} drives of {agent}, failed: {failed}")


def prove_import() -> None:
    """SUMO's netconvert and sumo find their data: two streets of OpenStreetMap become a network."""
    Path("streets.osm").write_text(STREETS, encoding="utf-8")
    run("dohyo", "networks", "import", "streets.osm", "--name", "streets")


def run(*command: str) -> str:
    """Runs a command, and returns what it printed; a failure ends the proof with its messages."""
    began = time.monotonic()
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        print(done.stdout, done.stderr, sep="\n", file=sys.stderr)
    check(done.returncode == 0, f"{' '.join(command)} ({time.monotonic() - began:.0f} s)")
    return done.stdout


def check(holds: bool, what: str) -> None:
    """Prints what holds, and ends the proof where something does not."""
    print(f"{'proved' if holds else 'FAILED'}: {what}", flush=True)
    if not holds:
        log = Path("service.log")
        sys.exit(log.read_text()[-2000:] if log.exists() else 1)


if __name__ == "__main__":
    main()
