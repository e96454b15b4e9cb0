"""Settings: files, overrides, and what is said about mistakes."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dohyo.agents.learning.algorithms.ppo_config import PpoConfig, PpoRunConfig
from dohyo.agents.learning.files.settings import as_toml, differences, read_settings
from dohyo.sumo_networks.config import Config
from dohyo.sumo_networks.errors import InvalidInputError


class Odd(Config):
    text: str
    maybe: float | None = None
    path: Path = Path("a/b")
    rows: tuple[dict[str, int], ...] = ()


def written(folder: Path, text: str) -> Path:
    path = folder / "c.toml"
    path.write_text(text)
    return path


def test_a_file_and_overrides_in_their_order(tmp_path):
    path = written(tmp_path, "seed = 3\n[ppo]\nclip = 0.1\n")
    config = read_settings(PpoRunConfig, path, ["ppo.clip=0.3", "ppo.clip = 0.15", "device=cpu", "ppo.hidden=[8, 8]"])
    assert (config.seed, config.ppo.clip, config.device, config.ppo.hidden) == (3, 0.15, "cpu", (8, 8))
    assert config.ppo.gamma == PpoConfig().gamma


class Small(PpoRunConfig):
    ppo: PpoConfig = PpoConfig(hidden=(4,), clip=0.4)


def test_a_table_given_in_part_keeps_the_rest_of_its_default(tmp_path):
    config = read_settings(Small, written(tmp_path, "[ppo]\nclip = 0.1\n"))
    assert (config.ppo.hidden, config.ppo.clip) == ((4,), 0.1)


class Nested(Config):
    small: Small = Small(seed=3, ppo=PpoConfig(hidden=(5,), clip=0.3))


def test_a_table_inside_a_table_given_in_part_keeps_the_rest_of_the_outer_default():
    inner = read_settings(Nested, None, ["small.ppo.gamma=0.5"]).small
    assert (inner.seed, inner.ppo.hidden, inner.ppo.clip, inner.ppo.gamma) == (3, (5,), 0.3, 0.5)


@pytest.mark.parametrize(
    ("text", "overrides", "message"),
    [
        ("stepps = 3", [], "unknown key 'stepps'; did you mean 'steps'?"),
        ("[ppo]\nlearning_rte = 3", [], "unknown key 'ppo.learning_rte'; did you mean 'learning_rate'?"),
        ("", ["ppo.zzz=1"], "unknown key 'ppo.zzz' (there is batch, clip"),
        ("steps = 'many'", [], "steps: Input should be a valid integer"),
        ("[ppo]\nclip = 7", [], "ppo.clip: Input should be less than 1, got 7"),
        ("ppo = 7", [], "ppo: "),
        ("seed = 7", ["seed.x=1"], "--set seed.x=1: 'seed' is no table"),
        ("", ["seed"], "expected --set key=value, got 'seed'"),
        ("", ["=1"], "expected --set key=value"),
        ("seed = = 1", [], "is no TOML"),
        ("ppo.entropy = nan", [], "ppo.entropy: "),
    ],
)
def test_mistakes_are_named(text, overrides, message, tmp_path):
    with pytest.raises(InvalidInputError) as caught:
        read_settings(PpoRunConfig, written(tmp_path, text), overrides)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_what_is_missing_is_named(tmp_path):
    with pytest.raises(InvalidInputError, match="text is missing"):
        read_settings(Odd, None)
    with pytest.raises(InvalidInputError, match=r"unknown key 'txt'; did you mean 'text'\?"):
        read_settings(Odd, None, ["txt=a"])
    with pytest.raises(InvalidInputError, match="cannot read"):
        read_settings(Odd, tmp_path / "none.toml")


@given(
    st.text(st.characters(exclude_categories=["Cs", "Cc"])),
    st.none() | st.floats(allow_nan=False, allow_infinity=False),
    st.lists(st.dictionaries(st.text("abc ", min_size=1), st.integers(-(2**40), 2**40))),
)
def test_a_written_configuration_reads_back_the_same(tmp_path_factory, text, maybe, rows):
    config = Odd(text=text, maybe=maybe, rows=tuple(rows))
    assert read_settings(Odd, written(tmp_path_factory.mktemp("c"), as_toml(config))) == config


def test_nested_tables_read_back_the_same(tmp_path):
    config = PpoRunConfig(seed=9, ppo=PpoConfig(learning_rate=1e-5, hidden=(1, 2, 3)))
    assert read_settings(PpoRunConfig, written(tmp_path, as_toml(config))) == config


def test_differences_name_the_key_and_both_values():
    old, new = PpoRunConfig(seed=1), PpoRunConfig(seed=2, steps=7, ppo=PpoConfig(clip=0.1))
    assert differences(old, new, frozenset({"steps"})) == ["seed = 1, not 2", "ppo.clip = 0.2, not 0.1"]
    assert differences(old, old, frozenset()) == []
