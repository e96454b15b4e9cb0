"""Settings on the command line: what the README's commands write, Python's spelling, and text."""

from __future__ import annotations

from typing import Any

import pytest

from dohyo.service.cli.commands.evaluate import parse_settings
from dohyo.sumo_networks.errors import InvalidInputError


@pytest.mark.parametrize(
    ("word", "value"),
    [
        ("false", False), ("true", True), ("null", None), ("False", False), ("None", None), ("3", 3), ("1e-3", 1e-3),
        ("[1, 2]", [1, 2]), ("rule", "rule"), ("'true'", "true"), ("out/a.onnx", "out/a.onnx"), ("", ""),
        ("{[1]: 2}", "{[1]: 2}"), ("-" * 100_000 + "1", "-" * 100_000 + "1"),
    ],
)  # fmt: skip
def test_a_setting_is_a_word_of_json_a_literal_or_text(word: str, value: Any) -> None:
    found = parse_settings([f"rules={word}"])["rules"]
    assert found == value
    assert type(found) is type(value)


def test_what_has_no_name_is_refused() -> None:
    with pytest.raises(InvalidInputError, match="--set 'rules': expected key=value"):
        parse_settings(["rules"])
