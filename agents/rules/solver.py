"""Solver: from the facts of one moment to the answer set and the fired rules."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from clingo import Control, Function, MessageCode, Number, Symbol
from clingo.ast import AST, ProgramBuilder

from dohyo.agents.rules.rulebook import (
    BROKEN,
    DENIED,
    FIRED,
    Pattern,
    Rule,
    Rulebook,
    RuleError,
    Signature,
    first_message,
)
from dohyo.evaluation.agent import Explanation

OPTIONS = ("--warn=no-atom-undefined",)


class Fact(NamedTuple):
    """Atom given by the world: `fact("speed", 83)` is speed(83).

    Attributes:
        name: Of the predicate.
        arguments: Whole numbers and names.
        holds: False for the strong negation -speed(83).
    """

    name: str
    arguments: tuple[int | str, ...]
    holds: bool = True

    def __str__(self) -> str:
        return str(self.symbol)

    @property
    def symbol(self) -> Symbol:
        """Text for clingo."""
        terms = [Number(value) if isinstance(value, int) else Function(value) for value in self.arguments]
        return Function(self.name, terms, self.holds)

    @property
    def looks(self) -> tuple[str, tuple[str | None, ...], bool]:
        """Pattern: all arguments except numbers."""
        return self.name, tuple(value if isinstance(value, str) else None for value in self.arguments), self.holds


def fact(name: str, *arguments: int | str, holds: bool = True) -> Fact:
    """See `Fact`."""
    return Fact(name, arguments, holds)


@dataclass(frozen=True, slots=True)
class Fired:
    """A fired rule, and its head."""

    rule: Rule
    atom: str


@dataclass(frozen=True, slots=True)
class Decision:
    """Result of the rules for one moment.

    Attributes:
        facts: The given atoms.
        actions: Orders in the answer set.
        atoms: The whole answer set, with the facts.
    """

    facts: tuple[Fact, ...]
    actions: tuple[Symbol, ...]
    atoms: tuple[Symbol, ...]

    @property
    def answer(self) -> list[Symbol]:
        """Answer set without the facts, sorted."""
        return sorted(set(self.atoms) - {one.symbol for one in self.facts})

    def numbers(self, action: str) -> list[int]:
        """First arguments of all actions of a name, smallest first."""
        return sorted(atom.arguments[0].number for atom in self.actions if atom.name == action)

    def names(self, action: str) -> list[str]:
        """First arguments that are names."""
        return sorted(atom.arguments[0].name for atom in self.actions if atom.name == action)

    def orders(self, action: str) -> bool:
        """Whether there is an action of a name."""
        return any(atom.name == action for atom in self.actions)


class Solver:
    """Grounds and solves a rulebook for successive moments, without state between them.

    The files are parsed once. The cost of grounding depends on the number of rules, so only those are grounded that can
    fire for the patterns of the facts. The answers are the same.
    """

    def __init__(self, rulebook: Rulebook) -> None:
        """Checks the rulebook on a moment without any facts.

        Raises:
            RuleError: A variable is unsafe, or the rules contradict each other for any facts.
        """
        self.rulebook = rulebook
        self._actions = {action.name for action in rulebook.actions}
        self._programs: dict[frozenset[tuple[object, ...]], list[AST]] = {}
        self._models(rulebook.plain(rulebook.rules), ())
        self.decide(())

    def decide(self, facts: Iterable[Fact]) -> Decision:
        """Answer set of a moment.

        Args:
            facts: Atoms of predicates that the rulebook declares as facts.

        Raises:
            RuleError: A fact is not declared; or the rules have no answer set, or more than one, for these facts.
        """
        given = tuple(facts)
        models = self._models(self._program(given), given)
        if not models:
            raise RuleError(self._contradiction(given))
        if len(models) > 1:
            raise RuleError(self._ambiguity(given))
        actions = (atom for atom in models[0] if atom.name in self._actions)
        return Decision(given, tuple(actions), tuple(models[0]))

    def fired(self, decision: Decision) -> tuple[Fired, ...]:
        """Fired rules of a decision, in the order of the rulebook."""
        (model,) = self._models(self.rulebook.traced(self.rulebook.rules), decision.facts)
        atoms = [atom for atom in model if atom.name.startswith(FIRED)]
        atoms.sort(key=lambda atom: (atom.arguments[0], atom))
        return tuple(Fired(self.rulebook.rules[atom.arguments[0].number], _given(atom)) for atom in atoms)

    def explanation(self, decision: Decision) -> Explanation:
        """For `Agent.explain`: facts, answer set and fired rules, with the place and reason of each."""
        return {
            "facts": [str(one) for one in decision.facts],
            "actions": sorted(str(one) for one in decision.actions),
            "answer_set": [str(one) for one in decision.answer],
            "fired": [
                {"atom": one.atom, "rule": one.rule.place, "text": one.rule.text, "why": one.rule.why}
                for one in self.fired(decision)
            ],
            "rulebook": self.rulebook.version[:12],
        }

    def _program(self, facts: Sequence[Fact]) -> list[AST]:
        key = frozenset(one.looks for one in facts)
        if key not in self._programs:
            given = [Pattern(Signature(name, len(names), holds), names) for name, names, holds in key]
            for one in given:
                if one.signature not in self.rulebook.facts:
                    raise RuleError(f"fact {one.signature}: no rule file declares it: #defined {one.signature}.")
            self._programs[key] = self.rulebook.plain(self.rulebook.able(given))
        return self._programs[key]

    def _models(self, statements: Sequence[AST], facts: Sequence[Fact]) -> list[list[Symbol]]:
        """At most two answer sets."""
        messages: list[str] = []

        def note(code: MessageCode, message: str) -> None:
            if code == MessageCode.RuntimeError:
                messages.append(message)

        control = Control(["--models=2", *OPTIONS], logger=note)
        try:
            with ProgramBuilder(control) as builder:
                for statement in statements:
                    builder.add(statement)
            with control.backend() as backend:
                for one in facts:
                    backend.add_rule([backend.add_atom(one.symbol)])
            control.ground([("base", [])])
        except RuntimeError as error:
            folder = self.rulebook.files[0].parent if self.rulebook.files else Path()
            raise RuleError(first_message(messages, folder) or str(error)) from error
        with control.solve(yield_=True) as found:
            return [list(model.symbols(atoms=True)) for model in found]

    def _contradiction(self, facts: Sequence[Fact]) -> str:
        """Rules that leave no answer set."""
        relaxed, rules = [_relaxed(one) for one in facts], self.rulebook.rules
        models = self._models(self.rulebook.relaxed(), relaxed)
        for model in models:
            for atom in sorted(model):
                if atom.name == BROKEN:
                    rule = rules[atom.arguments[0].number]
                    return f"{rule.place}: no answer set: this constraint is broken: {rule.text}"
            atoms = set(model)
            for atom in sorted(model):
                if Function(f"{DENIED}{atom.name}", atom.arguments) in atoms:
                    one, other = self._said(model, atom, True), self._said(model, atom, False)
                    return f"{one}: contradicts {other}: {atom} and -{atom}"
        for rule in sorted(rules, key=lambda rule: not rule.negates):
            if self._models(self.rulebook.relaxed(without=rule.number), relaxed):
                return f"{rule.place}: no answer set: it depends on its own negation: {rule.text}"
        return "no answer set"

    def _said(self, model: Sequence[Symbol], atom: Symbol, positive: bool) -> str:
        """Place of the rule behind an atom or its negation."""
        signature = Signature(atom.name, len(atom.arguments), positive)
        for one in model:
            if one.name == signature.fired and one.arguments[1:] == atom.arguments:
                return self.rulebook.rules[one.arguments[0].number].place
        given = [rule for rule in self.rulebook.rules if rule.head == signature and not rule.needs]
        return given[0].place if given else "a fact"

    def _ambiguity(self, facts: Sequence[Fact]) -> str:
        """Rule that fires in one answer set only."""
        first, second = (set(model) for model in self._models(self.rulebook.traced(self.rulebook.rules), facts))
        differ = sorted(atom for atom in first ^ second if atom.name.startswith(FIRED))
        rule = self.rulebook.rules[differ[0].arguments[0].number]
        return f"{rule.place}: more than one answer set: nothing decides whether this rule fires: {rule.text}"


def _relaxed(one: Fact) -> Fact:
    return one if one.holds else Fact(f"{DENIED}{one.name}", one.arguments)


def _given(fired: Symbol) -> str:
    """Head of a `_fired_` atom, as written in the rule."""
    name = fired.name.removeprefix(FIRED)
    positive = not name.startswith(DENIED)
    return str(Function(name.removeprefix(DENIED), fired.arguments[1:], positive))
