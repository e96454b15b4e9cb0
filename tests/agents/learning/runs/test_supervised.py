"""Supervised learning: the loop fits, keeps the best weights, and goes on where it stopped."""

from __future__ import annotations

import signal
from contextlib import closing
from itertools import islice
from pathlib import Path

import pytest
import torch
from torch import Tensor, nn

from dohyo.agents.learning.files.checkpoint import load_checkpoint, save_checkpoint
from dohyo.agents.learning.runs.run import Run, RunStoppedError
from dohyo.agents.learning.runs.supervised import Cosine, Fit, Rate, SupervisedConfig, drawn, fit, shuffled
from dohyo.sumo_networks.errors import InvalidInputError

INPUTS = torch.linspace(-1.0, 1.0, 40)[:, None]
TARGETS = 3.0 * INPUTS + 1.0


def line(batches=shuffled, **changes: object) -> Fit:
    """A line to be found in 40 points."""
    torch.manual_seed(0)
    network = nn.Linear(1, 1)

    def losses(rows: Tensor) -> dict[str, Tensor]:
        noise = 0.01 * torch.randn(len(rows), 1)  # so that torch's generator matters
        return {"loss": (network(INPUTS[rows] + noise) - TARGETS[rows]).square().mean()}

    def validate() -> dict[str, float]:
        with torch.no_grad():
            return {"error": float((network(INPUTS) - TARGETS).abs().mean())}

    settings = {
        "network": network,
        "optimizer": torch.optim.Adam(network.parameters()),
        "losses": losses,
        "batches": batches(len(INPUTS), 8, 0),
        "rate": Cosine(0.2, 60),
        "steps": 60,
        "validate": validate,
        "validate_every": 20,
        "columns": ("loss", "error"),
    }
    return Fit(**settings | changes)  # type: ignore[arg-type]


def run(folder: Path, resume: bool = False) -> closing[Run[SupervisedConfig]]:
    data = folder.parent / "data"
    (data / "train").mkdir(parents=True, exist_ok=True)
    config = SupervisedConfig(data=data, checkpoint_s=1e-9, tensorboard=False, device="cpu")
    return closing(Run("line", folder, config, resume))


def test_it_finds_the_line_and_reports_every_step():
    job, rows = line(), []
    fit(job, progress=lambda step, row: rows.append((step, dict(row))))
    assert job.validate()["error"] < 0.2
    assert [step for step, _ in rows] == list(range(1, 61))
    assert [step for step, row in rows if "error" in row] == [20, 40, 60]


class _HaltError(Exception):
    pass


def _halt_at(last: int):
    def progress(step: int, row: object) -> None:
        if step == last:
            raise _HaltError

    return progress


@pytest.mark.parametrize("batches", [shuffled, drawn])
def test_a_training_that_was_cut_off_ends_as_one_that_was_not(batches, tmp_path):
    whole = line(batches, steps=24, validate_every=5)
    with run(tmp_path / "whole") as folder:
        fit(whole, folder)
    with run(tmp_path / "part") as folder, pytest.raises(_HaltError):
        fit(line(batches, steps=24, validate_every=5), folder, _halt_at(13))
    rest = line(batches, steps=24, validate_every=5)
    with run(tmp_path / "part", resume=True) as folder:
        assert folder.steps_before == 12
        fit(rest, folder)
    assert torch.equal(whole.network.weight, rest.network.weight)
    tables = [(tmp_path / name / "metrics.csv").read_text() for name in ("whole", "part")]
    assert tables[0] == tables[1]


def test_a_signal_writes_a_checkpoint_and_ends(tmp_path):
    def progress(step: int, row: object) -> None:
        if step == 7:
            signal.raise_signal(signal.SIGTERM)

    with run(tmp_path / "run") as folder, pytest.raises(RunStoppedError, match="step 7 of 60"):
        fit(line(), folder, progress)
    with run(tmp_path / "run", resume=True) as folder:
        assert folder.steps_before == 7


def test_a_training_goes_on_with_its_own_data_alone(tmp_path):
    with run(tmp_path / "run") as folder:
        fit(line(steps=12), folder)
    (tmp_path / "data" / "features").mkdir()
    (tmp_path / "data" / "features" / "cache.npy").write_bytes(b"of another training")
    with run(tmp_path / "run", resume=True) as folder:
        fit(line(steps=24), folder)
    before = {path: path.read_bytes() for path in (tmp_path / "run").rglob("*") if path.is_file()}
    (tmp_path / "data" / "train" / "more.npz").write_bytes(b"rows")
    told = r"the run in '.*run' was started with data of the digest \w{12}, got \w{12} in '.*data'"
    with run(tmp_path / "run", resume=True) as folder, pytest.raises(InvalidInputError, match=told):
        fit(line(steps=36), folder)
    assert {path: path.read_bytes() for path in (tmp_path / "run").rglob("*") if path.is_file()} == before


def test_a_checkpoint_without_a_digest_of_its_data_is_resumed(tmp_path):
    with run(tmp_path / "run") as folder:
        fit(line(steps=12), folder)
    state = load_checkpoint(tmp_path / "run")
    assert len(state.pop("data_sha256")) == 64
    save_checkpoint(tmp_path / "run", 12, state)
    (tmp_path / "data" / "train" / "more.npz").write_bytes(b"rows")
    with run(tmp_path / "run", resume=True) as folder:
        fit(line(steps=24), folder)
        assert folder.steps_before == 12


class _Rising(Rate):
    """Leaves the best weights behind, and hears of it."""

    def __init__(self) -> None:
        self.heard: list[tuple[int, bool]] = []

    def at(self, step: int) -> float | None:
        return 0.2 if step < 40 else 10.0 if step < 55 else None

    def validated(self, step: int, better: bool) -> None:
        self.heard.append((step, better))


def test_the_best_weights_stay_and_the_rate_decides_the_end():
    rate, steps = _Rising(), []
    job = line(rate=rate, keeps_best=True)
    fit(job, progress=lambda step, row: steps.append((step, row.get("error"))))
    assert steps[-1][0] == 55
    assert rate.heard == [(20, True), (40, True)]
    assert job.validate()["error"] == steps[39][1]


def test_untrained_weights_may_be_the_best():
    job = line(rate=_Constant(50.0), keeps_best=True)
    untrained = job.network.weight.clone()
    fit(job)
    assert torch.equal(job.network.weight, untrained)


class _Constant(Rate):
    def __init__(self, rate: float) -> None:
        self.rate = rate

    def at(self, step: int) -> float:
        return self.rate


def test_every_epoch_has_every_row_once_in_its_own_order():
    batches = list(islice(shuffled(12, 4, 7)(0), 6))
    first, second = torch.cat(batches[:3]).tolist(), torch.cat(batches[3:]).tolist()
    assert sorted(first) == sorted(second) == list(range(12))
    assert first != second
    assert len(next(shuffled(3, 8, 0)(0))) == 3, "a data set may be smaller than a batch"


@pytest.mark.parametrize("kind", [shuffled, drawn])
def test_the_batches_of_a_step_do_not_depend_on_where_one_begins(kind):
    from_start = list(islice(kind(13, 4, 1)(0), 9))
    for step in (1, 3, 5):
        assert all(a.equal(b) for a, b in zip(from_start[step:], kind(13, 4, 1)(step), strict=False))


def test_the_rate_rises_stays_and_falls_to_zero():
    rate = Cosine(3e-3, steps=24, warm_up=4, falls_from=18)
    rates = [rate.at(step) for step in range(25)]
    assert rates[0] == pytest.approx(3e-3 / 4)
    assert rates[4:19] == [pytest.approx(3e-3)] * 15
    assert rates[21] == pytest.approx(1.5e-3)
    assert rates[24] == pytest.approx(0.0, abs=1e-12)
