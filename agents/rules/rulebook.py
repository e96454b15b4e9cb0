"""Rulebook: rules in Answer Set Programming, read from files, checked, and instrumented to report which fired.

A rulebook is a folder of `.lp` files. `#defined p/n.` declares a fact that the world may give, `#show p/n.` an action
that the rules may take; every other predicate must be the head of some rule. Only plain rules and constraints are
allowed, so that a rulebook has one answer and every atom of it a rule.

To report which rules fired, each rule `head :- body` is read as `_fired_head(number) :- body` and
`head :- _fired_head(number)`: the answer set itself contains it, with its arguments.
"""

from __future__ import annotations

import difflib
import hashlib
import re
from collections import defaultdict
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType

from clingo import MessageCode, Number, SymbolType
from clingo import ast as syntax
from clingo.ast import AST, ASTType, Sign, Transformer

from dohyo.sumo_networks.errors import InvalidInputError

FIRED, DENIED, BROKEN = "_fired_", "_not_", "_broken"
_IGNORED = (ASTType.Program, ASTType.Comment)
_MINUS = 0


class RuleError(InvalidInputError):
    """A rulebook cannot be used; the message begins with file and line."""


@dataclass(frozen=True, slots=True, order=True)
class Signature:
    """A predicate: name, number of arguments, and whether it is strongly negated."""

    name: str
    arity: int
    positive: bool = True

    def __str__(self) -> str:
        return f"{'' if self.positive else '-'}{self.name}/{self.arity}"

    @property
    def fired(self) -> str:
        """Name of the predicate that reports the rule behind it."""
        return f"{FIRED}{'' if self.positive else DENIED}{self.name}"


@dataclass(frozen=True, slots=True)
class Pattern:
    """Pattern of an atom: its predicate, and those of its arguments that are names; None stands for any."""

    signature: Signature
    names: tuple[str | None, ...]

    def meets(self, other: Pattern) -> bool:
        """Whether an atom may match both."""
        pairs = zip(self.names, other.names, strict=True)
        return self.signature == other.signature and all(a is None or b is None or a == b for a, b in pairs)


@dataclass(frozen=True, slots=True)
class Rule:
    """One rule of a file.

    Attributes:
        number: In the rulebook, from 0.
        file: Name of the file.
        line: Where the rule begins.
        text: As clingo prints it.
        why: The comment before it, on one line; empty without one.
        head: Derived atom; None for a constraint.
        gives: Pattern of the head.
        needs: Atoms without which it cannot fire.
        statement: As parsed.
    """

    number: int
    file: str
    line: int
    text: str
    why: str
    head: Signature | None
    gives: Pattern | None
    needs: tuple[Pattern, ...]
    statement: AST = field(repr=False, compare=False)

    @property
    def place(self) -> str:
        """File and line."""
        return f"{self.file}:{self.line}"

    @property
    def negates(self) -> bool:
        """Whether it has a negated atom (`not`) in its body."""
        return any(item.sign == Sign.Negation for item in self.statement.body if item.ast_type == ASTType.Literal)

    def can_fire(self, known: Mapping[Signature, Collection[Pattern]]) -> bool:
        """Whether each needed atom may be among given ones, which are sorted by their predicates."""
        return all(any(need.meets(one) for one in known.get(need.signature, ())) for need in self.needs)


@dataclass(frozen=True, slots=True)
class Rulebook:
    """A folder of rules, ready to be grounded.

    Attributes:
        rules: In the order of files and lines.
        facts: Predicates that the world may give.
        actions: Predicates of orders, with the places of their declarations.
        version: sha256 of all files.
        files: Its files.
    """

    rules: tuple[Rule, ...]
    facts: frozenset[Signature]
    actions: Mapping[Signature, str]
    version: str
    files: tuple[Path, ...]

    def able(self, given: Collection[Pattern]) -> list[Rule]:
        """Rules that can fire if all facts match one of the given patterns."""
        known = defaultdict[Signature, set[Pattern]](set)
        able, left, new = list[Rule](), list(self.rules), list(given)
        while True:
            for pattern in new:
                known[pattern.signature].add(pattern)
            found = {rule.number: rule for rule in left if rule.can_fire(known)}
            if not found:
                return sorted(able, key=lambda rule: rule.number)
            able += found.values()
            left = [rule for rule in left if rule.number not in found]
            new = [rule.gives for rule in found.values() if rule.gives is not None]

    def plain(self, rules: Sequence[Rule]) -> list[AST]:
        """Statements of a program of some rules."""
        return [rule.statement for rule in rules]

    def traced(self, rules: Sequence[Rule]) -> list[AST]:
        """Statements of the program that reports which rules fired."""
        statements = [_traced(rule) if _has_body(rule) else rule.statement for rule in rules]
        heads = {rule.head for rule in rules if rule.head is not None and _has_body(rule)}
        return statements + [_projection(head) for head in sorted(heads)]

    def relaxed(self, without: int = -1) -> list[AST]:
        """The same, but with contradictions and broken constraints as atoms, so that they can be reported.

        Args:
            without: Number of a rule to leave out.
        """
        relax, rules = _Relax(), [rule for rule in self.rules if rule.number != without]
        traced = [_traced(rule) if _has_body(rule) or rule.head is None else rule.statement for rule in rules]
        heads = {rule.head for rule in rules if rule.head is not None and _has_body(rule)}
        return [relax(statement) for statement in (*traced, *(_projection(head) for head in sorted(heads)))]


def read_rulebook(folder: Path) -> Rulebook:
    """Reads and checks all `.lp` files of a folder, in the order of their names.

    Raises:
        RuleError: There is no file, or one cannot be used; the message has file and line.
    """
    files = tuple(sorted(folder.glob("*.lp")))
    if not files:
        raise RuleError(f"{folder}: no rule files (*.lp)")
    rules: list[Rule] = []
    facts: set[Signature] = set()
    actions: dict[Signature, str] = {}
    texts = [_read(file) for file in files]
    for file in files:
        for statement, why in _statements(file):
            kind, place = statement.ast_type, f"{file.name}:{statement.location.begin.line}"
            if kind == ASTType.Rule:
                line, head = statement.location.begin.line, _head(statement, place)
                gives = None if head is None else _pattern(statement.head.atom.symbol)
                text, needs = str(statement), _needs(statement)
                rules.append(Rule(len(rules), file.name, line, text, why, head, gives, needs, statement))
            elif kind == ASTType.Defined:
                facts.add(_signature(statement))
            elif kind == ASTType.ShowSignature:
                actions[_signature(statement)] = place
            else:
                raise RuleError(f"{place}: expected a rule, a constraint, #defined or #show: {statement}")
    _check_predicates(rules, facts, actions)
    named = (file.name.encode() + text for file, text in zip(files, texts, strict=True))
    version = hashlib.sha256(b"".join(named)).hexdigest()
    return Rulebook(tuple(rules), frozenset(facts), MappingProxyType(actions), version, files)


def _read(file: Path) -> bytes:
    """A rule file; clingo itself ends the process where one is no text."""
    try:
        text = file.read_bytes()
        text.decode()
    except (OSError, UnicodeDecodeError) as error:
        raise RuleError(f"{file}: expected a file of rules in UTF-8: {error}") from error
    return text


def _statements(file: Path) -> Iterator[tuple[AST, str]]:
    """Each statement with the comment directly before it."""
    found: list[AST] = []
    messages: list[str] = []

    def note(code: MessageCode, message: str) -> None:
        messages.append(message)

    try:
        syntax.parse_files([str(file)], found.append, logger=note)
    except RuntimeError as error:
        raise RuleError(first_message(messages, file.parent) or f"{file.name}: {error}") from error
    comment: list[str] = []
    last = -1
    for statement in found:
        line = statement.location.begin.line
        if statement.ast_type == ASTType.Comment:
            comment = [*comment, str(statement)] if line == last + 1 else [str(statement)]
            last = line
        elif statement.ast_type not in _IGNORED:
            yield statement, " ".join(text.lstrip("% ").strip() for text in comment) if line == last + 1 else ""
            # Rules directly below share the comment.
            last = statement.location.end.line


def first_message(messages: Sequence[str], folder: Path) -> str:
    """Clingo's first message as one line: file:line: what is wrong."""
    if not messages:
        return ""
    text = " ".join(messages[0].replace(f"{folder}/", "").split())
    file, line, rest = text.split(":", 2)
    what = rest.split("error: ", 1)[-1]
    if what.startswith("unsafe"):
        what = "unsafe variables: " + ", ".join(sorted(set(re.findall(r"'(\w+)' is unsafe", what))))
    return f"{file}:{line}: {what}"


def _signature(statement: AST) -> Signature:
    return Signature(statement.name, statement.arity, bool(statement.positive))


def _head(rule: AST, place: str) -> Signature | None:
    head = rule.head
    if head.ast_type == ASTType.Literal and head.sign == Sign.NoSign:
        if head.atom.ast_type == ASTType.BooleanConstant and not head.atom.value:
            return None
        if head.atom.ast_type == ASTType.SymbolicAtom and (found := _of_symbol(head.atom.symbol)) is not None:
            if found.name.startswith("_"):
                raise RuleError(f"{place}: a name that begins with an underscore is reserved: {found}")
            return found
    raise RuleError(f"{place}: expected one plain atom as a rule's head, no choice and no disjunction: {rule}")


def _of_symbol(symbol: AST) -> Signature | None:
    positive = symbol.ast_type != ASTType.UnaryOperation
    function = symbol if positive else symbol.argument
    if function.ast_type != ASTType.Function:
        return None
    return Signature(function.name, len(function.arguments), positive)


def _needs(rule: AST) -> tuple[Pattern, ...]:
    """Atoms of the body without `not`."""
    plain = [item.atom for item in rule.body if item.ast_type == ASTType.Literal and item.sign == Sign.NoSign]
    found = [_pattern(atom.symbol) for atom in plain if atom.ast_type == ASTType.SymbolicAtom]
    return tuple(one for one in found if one is not None)


def _pattern(symbol: AST) -> Pattern | None:
    signature = _of_symbol(symbol)
    if signature is None:
        return None
    function = symbol if signature.positive else symbol.argument
    return Pattern(signature, tuple(_name(argument) for argument in function.arguments))


def _name(argument: AST) -> str | None:
    if argument.ast_type == ASTType.SymbolicTerm and argument.symbol.type == SymbolType.Function:
        return str(argument.symbol)
    # Names are functions without arguments.
    plain = argument.ast_type == ASTType.Function and not argument.arguments and not argument.external
    return str(argument.name) if plain and argument.name else None


class _Atoms(Transformer):
    """Collects the predicates of a statement, with their lines."""

    def __init__(self) -> None:
        self.found: list[tuple[Signature, int]] = []

    def visit_SymbolicAtom(self, node: AST) -> AST:  # noqa: N802
        signature = _of_symbol(node.symbol)
        if signature is not None:
            self.found.append((signature, node.symbol.location.begin.line))
        return node


def _check_predicates(rules: Sequence[Rule], facts: set[Signature], actions: dict[Signature, str]) -> None:
    known = facts | {rule.head for rule in rules if rule.head is not None}
    for rule in rules:
        atoms = _Atoms()
        atoms.visit_sequence(rule.statement.body)
        for signature, line in atoms.found:
            if signature not in known:
                raise RuleError(f"{rule.file}:{line}: unknown predicate '{signature}'{_hint(signature, known)}")
    for action, place in actions.items():
        if action not in known:
            raise RuleError(f"{place}: action '{action}' is the head of no rule{_hint(action, known)}")


def _hint(signature: Signature, known: set[Signature]) -> str:
    near = difflib.get_close_matches(str(signature), [str(one) for one in known], n=1)
    return f"; did you mean '{near[0]}'?" if near else ""


def _has_body(rule: Rule) -> bool:
    return rule.head is not None and len(rule.statement.body) > 0


def _traced(rule: Rule) -> AST:
    """Rule whose head names it; `_broken(number)` for a constraint."""
    where = rule.statement.location
    number = syntax.SymbolicTerm(where, Number(rule.number))
    if rule.head is None:
        name, arguments = BROKEN, [number]
    else:
        symbol = rule.statement.head.atom.symbol
        own = symbol if rule.head.positive else symbol.argument
        name, arguments = rule.head.fired, [number, *own.arguments]
    atom = syntax.SymbolicAtom(syntax.Function(where, name, arguments, 0))
    return rule.statement.update(head=syntax.Literal(where, Sign.NoSign, atom))


def _projection(head: Signature) -> AST:
    """Rule from the fired one to its head."""
    variables = ",".join(f"X{i}" for i in range(head.arity))
    arguments = f"({variables})" if variables else ""
    separator = "," if variables else ""
    text = f"{'' if head.positive else '-'}{head.name}{arguments} :- {head.fired}(_{separator}{variables})."
    out: list[AST] = []
    syntax.parse_string(text, out.append)
    return out[-1]


class _Relax(Transformer):
    """Replaces strong negation by a predicate of its own, without contradiction."""

    def visit_SymbolicAtom(self, node: AST) -> AST:  # noqa: N802
        symbol = node.symbol
        if symbol.ast_type != ASTType.UnaryOperation or symbol.operator_type != _MINUS:
            return node
        inner = symbol.argument
        return node.update(symbol=inner.update(name=f"{DENIED}{inner.name}"))
