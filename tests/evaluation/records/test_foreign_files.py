from __future__ import annotations

import pytest

from dohyo.evaluation.records.foreign_files import check_file_name
from dohyo.sumo_networks.errors import InvalidInputError


@pytest.mark.parametrize("name", ["a", "left-to-south-s0", "Town01.x_1", "console", "com10"])
def test_plain_names_are_file_names(name: str) -> None:
    assert check_file_name(name, "it") == name


@pytest.mark.parametrize("name", ["", ".", "..", ".a", "-a", "a/b", "a\\b", "a\nb", "a.", "con", "NUL.txt", "a" * 201])
def test_others_are_not(name: str) -> None:
    with pytest.raises(InvalidInputError, match="expected it to be a file name") as refused:
        check_file_name(name, "it")
    assert str(refused.value).isprintable()
