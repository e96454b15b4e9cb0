"""An evaluation on a Ray cluster of two hosts, whose link is cut meanwhile: it ends, and its records are those of one.

    python -m tests.performance.two_hosts [--cuts 0 4 90] [--benchmark quickstart] [--seeds 0] [--json FILE]

The hosts are two network namespaces of this machine, with a pair of virtual interfaces between them; so it needs root
and the program `ip`. The second host has a /tmp of its own, and starts Ray again whenever Ray has ended there, as an
init system does. For each length of a cut in seconds (0: none), `dohyo evaluate --executor ray` runs on the first host
with a worker on each one. The link is cut once the first episode is done. Expected are the records of this machine's
processes, hash for hash. The exit code is 1 where one differs, or an evaluation has not ended within ten minutes.
"""

from __future__ import annotations

import argparse
import json
import os
import secrets
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Final

PATIENCE_S: Final = 600.0
MEETING_S: Final = 180.0
HOSTS: Final = {"dohyo-one": "10.77.0.1", "dohyo-two": "10.77.0.2"}
FIRST, SECOND = HOSTS
PORT: Final = 6379
ADDRESS: Final = f"{HOSTS[FIRST]}:{PORT}"
LINK: Final = "dohyo-link"
BEGINS: Final = "Ray begins here"
RAY: Final = (sys.executable, "-m", "ray.scripts.scripts", "start", "--block", "--num-cpus=1")
ENVIRONMENT: Final = {
    "OMP_NUM_THREADS": "1",
    "RAY_USAGE_STATS_ENABLED": "0",
    "RAY_AUTH_MODE": "token",
    "RAY_AUTH_TOKEN": secrets.token_hex(32),
    "RAY_raylet_start_wait_time_s": "300",  # a loaded machine needs longer than Ray's own limit
}
AGAIN: Final = f"""mount -t tmpfs tmpfs /tmp; while :; do echo '{BEGINS}'; "$@"; sleep 1; done"""
"""Shell of the second host: a /tmp of its own, and Ray whenever none runs."""
TOGETHER: Final = f"""
import ray, time
while not ray.is_initialized():
    try:
        ray.init(address="{ADDRESS}", logging_level="error", log_to_driver=False)
    except (ConnectionError, RuntimeError, ValueError):
        time.sleep(1.0)
while sum(node["Alive"] for node in ray.nodes()) < 2:
    time.sleep(0.5)
"""


@dataclass(frozen=True)
class Row:
    """One evaluation.

    Attributes:
        cut_s: Length of the cut, s.
        seconds: Length of the evaluation, s.
        before: Episodes that were done when the link was cut.
        episodes: Episodes with a record at the end.
        equal: Those with the hash of this machine's processes.
        starts: How often Ray began on the second host.
        fault: Why it failed, in words.
    """

    cut_s: float
    seconds: float
    before: int
    episodes: int
    equal: int
    starts: int
    fault: str = ""

    @property
    def line(self) -> str:
        """A line of the table."""
        numbers = f"{self.cut_s:>7.0f}{self.before:>9}{self.seconds:>12.0f}{self.starts:>8}"
        return f"{numbers}{self.equal:>8} of {self.episodes}   {self.fault}"


@contextmanager
def hosts() -> Iterator[None]:
    """Two network namespaces with a link between them; at the end they go, with all processes in them."""
    try:
        for host in HOSTS:
            ip("netns", "add", host)
        ends = ("type", "veth", "peer", "name", LINK, "netns", SECOND)
        ip("link", "add", LINK, "netns", FIRST, *ends)
        for host, address in HOSTS.items():
            ip("-n", host, "addr", "add", f"{address}/24", "dev", LINK)
            ip("-n", host, "link", "set", "lo", "up")
            ip("-n", host, "link", "set", LINK, "up")
        yield
    finally:
        for host in HOSTS:
            for process in ip("netns", "pids", host, check=False).split():
                with suppress(ProcessLookupError):
                    os.kill(int(process), signal.SIGKILL)
            ip("netns", "delete", host, check=False)


def ip(*words: str, check: bool = True) -> str:
    """What the program `ip` prints."""
    return subprocess.run(["ip", *words], check=check, capture_output=True, text=True).stdout


def begin(host: str, command: Sequence[str], log: Path) -> subprocess.Popen[bytes]:
    """Begins a process on a host."""
    with log.open("ab") as lines:
        return subprocess.Popen(
            ["ip", "netns", "exec", host, *command],
            env=os.environ | ENVIRONMENT | {"RAY_TMPDIR": str(log.parent)},  # other clusters of this machine use /tmp
            stdin=subprocess.DEVNULL,
            stdout=lines,
            stderr=lines,
            start_new_session=True,
        )


@contextmanager
def cluster(folder: Path) -> Iterator[Path]:
    """A Ray cluster with a worker's processor on each host; gives the log of the second one."""
    options = ["--include-dashboard=false", "--object-store-memory=100000000"]
    head = ["--head", f"--port={PORT}", f"--node-ip-address={HOSTS[FIRST]}", *options]
    other = [f"--address={ADDRESS}", f"--node-ip-address={HOSTS[SECOND]}", options[1]]
    with hosts():
        begin(FIRST, [*RAY, *head], folder / "one.log")
        begin(SECOND, ["sh", "-c", AGAIN, "sh", *RAY, *other], folder / "two.log")
        together = begin(FIRST, [sys.executable, "-c", TOGETHER], folder / "together.log")
        try:
            failed = together.wait(MEETING_S)
        except subprocess.TimeoutExpired:
            failed = 1
        if failed:
            said = "".join((folder / name).read_text(errors="replace")[-1000:] for name in ("two.log", "together.log"))
            raise RuntimeError(f"the hosts do not meet: {said}")
        yield folder / "two.log"


def evaluate(options: argparse.Namespace, out: Path, *more: str) -> list[str]:
    """Command of the evaluation."""
    what = ["--agent", options.agent, "--benchmark", options.benchmark, "--seeds", options.seeds, "--out", str(out)]
    return [sys.executable, "-c", "from dohyo.service.cli import main; main()", "evaluate", *what, *more]


def hashes(out: Path) -> dict[str, str]:
    """Content hash of each record of a result folder, by its file."""
    documents = {path.name: json.loads(path.read_bytes()) for path in out.rglob("*.json")}
    return {name: one["record_hash"] for name, one in documents.items() if "record_hash" in one}


def with_cut(options: argparse.Namespace, cut_s: float, expected: dict[str, str], folder: Path) -> Row:
    """Evaluates on both hosts, and cuts the link for so long once an episode is done."""
    out = folder / "out"
    with cluster(folder) as log:
        ray = ("--executor", "ray", "--address", ADDRESS, "--workers", "2")
        began = time.monotonic()
        driver = begin(FIRST, evaluate(options, out, *ray), folder / "driver.log")
        before, down_at = 0, None
        while driver.poll() is None and time.monotonic() < began + PATIENCE_S:
            time.sleep(0.2)
            if cut_s and down_at is None and (before := len(hashes(out))):
                ip("-n", SECOND, "link", "set", LINK, "down")
                down_at = time.monotonic()
            if down_at is not None and time.monotonic() >= down_at + cut_s:
                ip("-n", SECOND, "link", "set", LINK, "up")
                down_at = float("inf")
        seconds, code = time.monotonic() - began, driver.poll()
        starts = log.read_text(errors="replace").count(BEGINS)
    found = hashes(out)
    equal = sum(found.get(name) == one for name, one in expected.items())
    fault = "; ".join(_failures(out, expected))
    if code != 0:
        said = (folder / "driver.log").read_text(errors="replace").strip()[-500:]
        fault = f"it ended with code {code}: {said}" if code is not None else "it has not ended"
    elif not fault and equal < len(expected):
        fault = "records are missing"
    return Row(cut_s, seconds, before, len(found), equal, starts, fault)


def _failures(out: Path, expected: dict[str, str]) -> Iterator[str]:
    """Records that are not as expected, with the failures that they tell of."""
    for path in sorted(out.rglob("*.json")):
        document = json.loads(path.read_bytes())
        if path.name in expected and document["record_hash"] != expected[path.name]:
            yield f"{path.stem}: {', '.join(str(ego['failure']) for ego in document['egos'])}"


def main() -> int:
    """Prints a row for each evaluation."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cuts", type=float, nargs="+", default=[0.0, 4.0, 90.0])
    parser.add_argument("--agent", default="autopilot")
    parser.add_argument("--benchmark", default="quickstart")
    parser.add_argument("--seeds", default="0")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    if os.geteuid() or shutil.which("ip") is None:
        parser.error("network namespaces need root and the program ip (Debian: apt-get install iproute2)")
    signal.signal(signal.SIGTERM, lambda number, frame: sys.exit(128 + number))  # the hosts go, too
    rows = []
    with tempfile.TemporaryDirectory() as name:
        here = Path(name) / "here"
        subprocess.run(evaluate(options, here), check=True, stdout=subprocess.DEVNULL)
        print(f"{'cut, s':>7}{'before':>9}{'in all, s':>12}{'starts':>8}{'equal':>8}", flush=True)
        for place, cut_s in enumerate(options.cuts):
            folder = Path(name) / str(place)
            folder.mkdir()
            rows.append(with_cut(options, cut_s, hashes(here), folder))
            print(rows[-1].line, flush=True)
    if options.json:
        options.json.write_text(json.dumps([asdict(row) for row in rows], indent=1) + "\n")
    return int(any(row.fault for row in rows))


if __name__ == "__main__":
    sys.exit(main())
