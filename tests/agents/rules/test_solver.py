"""Rulebooks: what is read, what is refused and where, and which rules fire."""

from __future__ import annotations

from pathlib import Path

import pytest

from dohyo.agents.rules.rulebook import RuleError, read_rulebook
from dohyo.agents.rules.solver import Fact, Solver, fact


def solver(folder: Path, text: str, **others: str) -> Solver:
    (folder / "book.lp").write_text(text)
    for name, more in others.items():
        (folder / f"{name}.lp").write_text(more)
    return Solver(read_rulebook(folder))


def answer(folder: Path, text: str, *facts: Fact) -> list[str]:
    return sorted(str(atom) for atom in solver(folder, text).decide(facts).answer)


# What is answered


@pytest.mark.parametrize("text", [b"go. % \xff\xfe\n", None], ids=["no UTF-8", "a folder"])
def test_what_is_no_text_is_refused_by_name(tmp_path: Path, text: bytes | None) -> None:
    if text is None:
        (tmp_path / "book.lp").mkdir()
    else:
        (tmp_path / "book.lp").write_bytes(text)
    with pytest.raises(RuleError, match=r"book\.lp: expected a file of rules in UTF-8"):
        read_rulebook(tmp_path)


def test_rules_calculate_with_the_facts(tmp_path: Path) -> None:
    book = "#defined speed/1.\n#defined gap/1.\nneeds(V*V/(2*G)) :- speed(V), gap(G).\n"
    assert answer(tmp_path, book, fact("speed", 100), fact("gap", 200)) == ["needs(25)"]


def test_nothing_survives_into_the_next_moment(tmp_path: Path) -> None:
    book = solver(tmp_path, "#defined red/0.\nstop :- red.\ngo :- not stop.\n")
    answers = [[str(atom) for atom in book.decide(facts).answer] for facts in ([fact("red")], [], [fact("red")])]
    assert answers == [["stop"], ["go"], ["stop"]]


def test_what_is_not_known_to_be_false_is_not_taken_for_false(tmp_path: Path) -> None:
    # The bus before the railway crossing: no train seen is not the same as no train.
    book = "#defined train/0.\n#defined -train/0.\ncross :- -train.\nrisk :- not train.\n"
    assert answer(tmp_path, book) == ["risk"]
    assert answer(tmp_path, book, fact("train", holds=False)) == ["cross", "risk"]
    assert answer(tmp_path, book, fact("train")) == []


def test_what_is_grounded_does_not_change_the_answer(tmp_path: Path) -> None:
    # Rules are left out by predicate and name; those with variables, and heads that other rules give, are not.
    book = (
        "#defined is/2.\nfoot(A) :- is(A,pedestrian).\nwheels(A) :- is(A,K), K != pedestrian.\n"
        "first(A) :- foot(A).\nfirst(A) :- kind(bus), wheels(A).\nkind(K) :- is(_,K).\nlast :- not foot(1).\n"
    )
    assert answer(tmp_path, book, fact("is", 1, "car")) == ["kind(car)", "last", "wheels(1)"]
    assert answer(tmp_path, book, fact("is", 1, "bus")) == ["first(1)", "kind(bus)", "last", "wheels(1)"]
    assert answer(tmp_path, book, fact("is", 1, "pedestrian")) == ["first(1)", "foot(1)", "kind(pedestrian)"]


def test_actions_are_what_is_shown(tmp_path: Path) -> None:
    book = solver(tmp_path, "#defined red/0.\n#show stop/1.\nstop(5) :- red.\nstop(2) :- red.\nwhy :- stop(_).\n")
    decision = book.decide([fact("red")])
    assert sorted(str(action) for action in decision.actions) == ["stop(2)", "stop(5)"]
    assert decision.numbers("stop") == [2, 5]
    assert decision.orders("stop")
    assert not decision.orders("why")


# Which rules fired


def test_each_atom_is_explained_by_the_rule_that_gave_it(tmp_path: Path) -> None:
    text = "#defined red/0.\n#defined far/0.\n% Red is red.\n%   Always.\nstop :- red.\nstop :- far.\n-go :- stop.\n"
    book = solver(tmp_path, text)
    fired = book.fired(book.decide([fact("red")]))
    assert [(one.atom, one.rule.place, one.rule.why) for one in fired] == [
        ("stop", "book.lp:5", "Red is red. Always."),
        ("-go", "book.lp:7", "Red is red. Always."),
    ]


def test_an_explanation_is_plain_json_with_facts_answer_and_rules(tmp_path: Path) -> None:
    book = solver(tmp_path, "#defined speed/1.\n#show go/0.\ngo :- speed(V), V < 5.\n")
    why = book.explanation(book.decide([fact("speed", 3)]))
    assert why["facts"] == ["speed(3)"]
    assert why["actions"] == ["go"]
    assert why["answer_set"] == ["go"]
    assert why["fired"] == [{"atom": "go", "rule": "book.lp:3", "text": "go :- speed(V); V < 5.", "why": ""}]


def test_the_version_follows_the_rules(tmp_path: Path) -> None:
    first = solver(tmp_path, "a.\n").rulebook.version
    assert solver(tmp_path, "a.\n").rulebook.version == first
    assert solver(tmp_path, "a. b.\n").rulebook.version != first
    assert solver(tmp_path, "a.\n", more="c.\n").rulebook.version != first


# What is refused, and where


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a.\nb :- a(.\n", r"^book\.lp:2: syntax error"),
        ("a.\nb :- a(X).\n", r"^book\.lp:2: unknown predicate 'a/1'; did you mean 'a/0'\?"),
        ("#defined train/0.\ncross :- -train.\n", r"^book\.lp:2: unknown predicate '-train/0'"),
        ("#defined a/1.\nb :- not c, a(_).\n", r"^book\.lp:2: unknown predicate 'c/0'"),
        ("#defined a/1.\n\nb(Y) :- a(X).\n", r"^book\.lp:3: unsafe variables: Y"),
        ("a.\n#show b/1.\n", r"^book\.lp:2: action 'b/1' is the head of no rule"),
        ("a.\n{b}.\n", r"^book\.lp:2: expected one plain atom"),
        ("a.\nb ; c.\n", r"^book\.lp:2: expected one plain atom"),
        ("a(1).\n#minimize { X : a(X) }.\n", r"^book\.lp:2: expected a rule"),
        ("a.\n_fired_a(1) :- a.\n", r"^book\.lp:2: .* reserved"),
        ("a.\n\n-a :- a.\n", r"^book\.lp:1: contradicts book\.lp:3: a and -a"),
        ("a.\n:- a.\n", r"^book\.lp:2: no answer set: this constraint is broken"),
        ("b.\na :- not a, b.\n", r"^book\.lp:2: no answer set: it depends on its own negation"),
        ("a :- not b.\nb :- not a.\n", r"^book\.lp:1: more than one answer set"),
    ],
)
def test_a_rulebook_that_cannot_be_used_is_refused_with_file_and_line(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(RuleError, match=message) as caught:
        solver(tmp_path, text)
    assert "\n" not in str(caught.value)


def test_the_other_file_is_named_where_it_is_wrong(tmp_path: Path) -> None:
    with pytest.raises(RuleError, match=r"^other\.lp:1: unknown predicate 'c/0'"):
        solver(tmp_path, "a.\n", other="b :- c.\n")


def test_what_contradicts_itself_only_for_some_facts_is_told_when_they_come(tmp_path: Path) -> None:
    book = solver(tmp_path, "#defined speed/1.\nfast(V) :- speed(V), V > 5.\n-fast(V) :- speed(V), V < 9.\n")
    assert [str(atom) for atom in book.decide([fact("speed", 3)]).answer] == ["-fast(3)"]
    with pytest.raises(RuleError, match=r"^book\.lp:2: contradicts book\.lp:3: fast\(7\) and -fast\(7\)"):
        book.decide([fact("speed", 7)])


def test_a_broken_constraint_is_told_when_it_is_broken(tmp_path: Path) -> None:
    book = solver(tmp_path, "#defined speed/1.\n\n:- speed(V), V > 5.\n")
    book.decide([fact("speed", 5)])
    with pytest.raises(RuleError, match=r"^book\.lp:3: no answer set: this constraint is broken"):
        book.decide([fact("speed", 6)])


def test_a_fact_that_no_file_declares_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RuleError, match=r"fact speed/1: no rule file declares it"):
        solver(tmp_path, "a.\n").decide([fact("speed", 3)])


def test_a_folder_without_rules_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RuleError, match=r"no rule files"):
        read_rulebook(tmp_path)
