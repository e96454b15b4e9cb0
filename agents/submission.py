"""Submission: a policy of GRIAD, RLAD or RLfOLD as an ONNX file that a service takes.

python -m dohyo.agents.submission rlad out/rlad/rlad/seed-0/best.onnx --out rlad.onnx
dohyo submit NAME --onnx rlad.onnx ...          # the command above prints the rest
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Final

from dohyo.agents.endless_driving import submission as endless_driving
from dohyo.agents.gri import submission as gri
from dohyo.agents.registry import TRAINABLE
from dohyo.evaluation.agent import AgentSpec, make_agent
from dohyo.sumo_networks.errors import DohyoError
from dohyo.sumo_networks.files import write_atomically

SUBMISSIONS: Final[Mapping[str, Callable[[Path], bytes]]] = {
    "griad": gri.submission_of,
    "rlad": partial(endless_driving.submission_of, trainer="rlad"),
    "rlfold": partial(endless_driving.submission_of, trainer="rlfold"),
}


def write_submission(name: str, policy: Path, out: Path) -> AgentSpec:
    """Writes the ONNX model of a policy.

    Args:
        name: Of `SUBMISSIONS`.
        policy: ONNX file of a training.
        out: File to be written.

    Returns:
        What the model sees, and its control.

    Raises:
        InvalidInputError: There is no such policy, or it sees what is no sensor.
    """
    agent = make_agent(TRAINABLE[name], {"policy": str(policy)})
    write_atomically(out, SUBMISSIONS[name](policy))
    return agent.spec


def main() -> None:
    """Command-line entry point."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("name", choices=sorted(SUBMISSIONS), help="the agent")
    parser.add_argument("policy", type=Path, help="ONNX file of its training, such as best.onnx")
    parser.add_argument("--out", type=Path, required=True, help="ONNX file to be written")
    options = parser.parse_args()
    try:
        spec = write_submission(options.name, options.policy, options.out)
    except DohyoError as error:
        raise SystemExit(f"dohyo: {error}") from error
    told = f"--track {spec.track} --sensors {','.join(spec.sensors)} --control {spec.control}"
    print(f"dohyo submit NAME --onnx {options.out} {told}")


if __name__ == "__main__":
    main()
