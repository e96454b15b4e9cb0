"""Errors of misspelled names say in words how a name is spelled."""

from __future__ import annotations

import pytest

from dohyo.service.accounts.model import Role
from dohyo.service.web.spelling import expected_spelling
from tests.service.harness import Harness, assert_problem


@pytest.mark.parametrize(
    ("path", "order", "expected"),
    [
        ("/v1/invitations/redeem", {"code": "x", "team": "reds?"}, "body.team: expected letters of ASCII, digits"),
        ("/v1/invitations/redeem", {"code": "x", "team": "blue  x"}, "body.team: expected letters of ASCII, digits, s"),
        ("/v1/invitations/redeem", {"code": "x", "team": "blue "}, "no space at the end"),
        ("/v1/challenges", {"name": "Autumn Cup", "title": "Cup"}, "body.name: expected small letters of ASCII"),
    ],
)  # fmt: skip
def test_a_misspelled_name_is_told_in_words(service: Harness, path: str, order: dict[str, str], expected: str) -> None:
    answer = service.caller("lab", Role.ORGANISER).post(path, order)
    assert_problem(answer, 422, expected)
    assert not {"^", "["} & set(answer.json()["detail"])


def test_a_misspelled_query_is_told_in_words(service: Harness) -> None:
    assert_problem(service.caller("ann").get("/v1/leaderboard", params={"benchmark": "a b"}), 422, "digits, '.', '_'")


def test_a_pattern_without_words_is_told_itself() -> None:
    assert expected_spelling("^x$") == "expected text that matches '^x$'"
