"""Cards: every weight in the repository has one that names its bytes, and a run writes those of its results."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import dohyo.agents
from dohyo.agents.learning.files.card import UNKNOWN, WEIGHTS, Card, digest, read_card, read_cards, write_card
from dohyo.agents.learning.runs.run import Run
from dohyo.sumo_networks.errors import InvalidInputError
from tests.agents.learning.toys import PointConfig

AGENTS = Path(dohyo.agents.__file__).parent
SHIPPED = sorted(path for ending in WEIGHTS for path in AGENTS.rglob(f"*{ending}"))
CARD = {
    "subject": "a test",
    "trainer": None,
    "command": UNKNOWN,
    "commits": UNKNOWN,
    "uncommitted": UNKNOWN,
    "config": {},
    "data_sha256": None,
    "seed": 0,
    "steps": 1,
    "device": "cpu",
    "tier": 3,
    "metrics": {"return": 1.5},
}


def stored(folder: Path, name: str, content: bytes = b"weights") -> Path:
    path = folder / f"{name}.safetensors"
    path.write_bytes(content)
    write_card(folder, name, Card(files={path.name: digest(path)}, **CARD))
    return path


def test_weights_are_shipped() -> None:
    assert len(SHIPPED) > 20


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: str(path.relative_to(AGENTS)))
def test_a_shipped_weight_file_is_the_one_of_its_card(path: Path) -> None:
    assert path.name in read_card(path).files


@pytest.mark.parametrize("folder", sorted({path.parent for path in SHIPPED}), ids=lambda path: path.parent.name)
def test_a_card_names_only_files_that_are_shipped(folder: Path) -> None:
    named = [name for card in read_cards(folder).values() for name in card.files]
    assert sorted(named) == sorted(path.name for path in SHIPPED if path.parent == folder)


def test_a_folder_has_a_card_for_every_model(tmp_path: Path) -> None:
    one, two = stored(tmp_path, "one"), stored(tmp_path, "two", b"others")
    stored(tmp_path, "one", b"weights, trained again")
    assert read_card(one).files["one.safetensors"] == digest(one) != digest(two)
    assert list(read_cards(tmp_path)) == ["one", "two"]


def test_other_weights_than_those_of_the_card_are_refused(tmp_path: Path) -> None:
    path = stored(tmp_path, "one")
    path.write_bytes(b"others")
    with pytest.raises(InvalidInputError, match=r"one\.safetensors': expected the file of its card"):
        read_card(path)
    (tmp_path / "two.onnx").write_bytes(b"")
    with pytest.raises(InvalidInputError, match=r"two\.onnx': no card in card\.json"):
        read_card(tmp_path / "two.onnx")


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b"{", "damaged"),
        (b"[]", "damaged"),
        (json.dumps({"one": CARD}).encode(), "files: Field required"),
        (json.dumps({"one": CARD | {"files": {"x": "0"}}}).encode(), "files.x"),
    ],
)
def test_a_damaged_card_is_refused(tmp_path: Path, content: bytes, says: str) -> None:
    (tmp_path / "card.json").write_bytes(content)
    with pytest.raises(InvalidInputError, match=says):
        read_cards(tmp_path)


def test_a_folder_without_cards_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InvalidInputError, match="expected the cards of the weights here"):
        read_cards(tmp_path)


def test_the_digest_of_a_folder_changes_with_names_and_bytes(tmp_path: Path) -> None:
    (tmp_path / "deep").mkdir()
    (tmp_path / "deep" / "a").write_bytes(b"1")
    first = digest(tmp_path)
    (tmp_path / "deep" / "a").rename(tmp_path / "a")
    moved = digest(tmp_path)
    (tmp_path / "a").write_bytes(b"2")
    assert len({first, moved, digest(tmp_path)}) == 3


def test_a_run_writes_the_card_of_its_results(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.argv", ["/usr/local/bin/dohyo", "train", "toy", "--set", "name='a b'"])
    run = Run("toy", tmp_path, PointConfig(seed=7, device="cpu", tensorboard=False))
    try:
        run.add_table("metrics", ())
        (tmp_path / "best.safetensors").write_bytes(b"weights")
        (tmp_path / "best.onnx").write_bytes(b"model")
        run.write_card("best", "point", 12, {"return": 1.5, "success": None})
    finally:
        run.close()
    card = read_card(tmp_path / "best.onnx")
    assert set(card.files) == {"best.safetensors", "best.onnx"}
    assert (card.trainer, card.subject, card.seed, card.steps, card.tier) == ("toy", "point", 7, 12, 3)
    assert card.command == """dohyo train toy --set 'name='"'"'a b'"'"''"""
    assert card.commits == (json.loads((tmp_path / "run.json").read_text())["sessions"][0]["commit"],)
    assert card.metrics == {"return": 1.5, "success": None}
