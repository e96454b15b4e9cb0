"""The rulebook: for each rule a scene in which it must fire, and one in which it must not."""

from __future__ import annotations

from dataclasses import dataclass

import pytest
from clingo import SymbolType, parse_term
from hypothesis import given, settings
from hypothesis import strategies as st

from dohyo.agents.rules.rulebook import read_rulebook
from dohyo.agents.rules.rules_only import RULES
from dohyo.agents.rules.solver import Decision, Fact, Solver, fact

BOOK = Solver(read_rulebook(RULES))
EGO = "speed(80). advised(120). standing(0). refused(0). sight(1790)."


@dataclass(frozen=True)
class Case:
    """An atom, a scene that gives it, and one that does not.

    Attributes:
        atom: What the rule derives.
        fires: Facts of the one, beside those of an ego that drives 8 m/s on a free road.
        holds_not: Facts of the other.
        speed: Of the ego in both, dm/s.
    """

    atom: str
    fires: str
    holds_not: str
    speed: int = 80

    def __str__(self) -> str:
        return self.atom


def parsed(text: str) -> list[Fact]:
    """ "p(1). -q(red)." as facts."""
    atoms = [parse_term(part.strip()) for part in text.split(".") if part.strip()]
    terms = [[t.number if t.type == SymbolType.Number else t.name for t in atom.arguments] for atom in atoms]
    return [fact(atom.name, *some, holds=atom.positive) for atom, some in zip(atoms, terms, strict=True)]


def facts(text: str, speed: int = 80) -> list[Fact]:
    """Facts of a scene; a speed, sight, standing or refused of its own replaces that of the free road."""
    told, own = parsed(text), parsed(EGO.replace("speed(80)", f"speed({speed})"))
    names = {one.name for one in told}
    return [*(one for one in own if one.name not in names), *told]


def decided(text: str, speed: int = 80) -> Decision:
    return BOOK.decide(facts(text, speed))


def answer(text: str, speed: int = 80) -> set[str]:
    return {str(atom) for atom in decided(text, speed).answer}


def crosses(priority: str = "", kind: str = "car", **at: int) -> str:
    """Somebody whose path meets the ego's 15 m ahead, and who is there when the ego is."""
    n, enter, leave, pace = at.get("n", 150), at.get("enter", 200), at.get("leave", 280), at.get("pace", 80)
    there = at.get("there", 20), at.get("left", 35)
    own = at.get("arrive", 18), at.get("clear", 30)
    return (
        f"meets(7,{kind},{n}). comes(7,{enter},{leave},{pace}). "
        f"ego_at(7,{own[0]},{own[1]}). other_at(7,{there[0]},{there[1]}). {priority}"
    )


MUST = "right_of_way(7)."
MAY = "-right_of_way(7)."
AHEAD = "ahead(7,car,300,0). extent(7,345). takes(7,80)."
PARKED = f"{AHEAD} stood(7,460). "
SITE = "ahead(7,static,300,0). extent(7,360). takes(7,90). stood(7,10). "
LEFT, AGAINST, RIGHT = "lane(left,same). ", "lane(left,against). ", "lane(right,same). "
OUT = "aside(left). "

LIGHTS = [
    Case("closed(1)", "junction(1,200,350). signal(1,red).", "junction(1,200,350). signal(1,green)."),
    Case("closed(1)", "junction(1,-4,150). signal(1,red).", "junction(1,-5,150). signal(1,red)."),
    Case("to_line(1,32)", "junction(1,103,350).", "junction(1,3,350)."),
    Case("closed(1)", "junction(1,103,350). signal(1,yellow).", "junction(1,80,350). signal(1,yellow)."),
    Case("-closed(1)", "junction(1,80,350). signal(1,yellow).", "junction(1,103,350). signal(1,yellow)."),
    Case("-closed(1)", "junction(1,200,350). signal(1,green).", "junction(1,200,350)."),
    Case("closed(1)", "junction(1,90,200). sign(1,stop).", "junction(1,90,200). sign(1,stop). stood_at(1)."),
    Case("closed(1)", "junction(1,90,200). sign(1,stop).", "junction(1,90,200). sign(1,yield)."),
    Case("closed(2)", "junction(2,90,200). sign(2,stop).", "junction(2,90,200). sign(2,stop). stood_at(2)."),
    Case("stop(200)", "junction(1,200,350). signal(1,red).", "junction(1,200,350). signal(1,green)."),
    Case("stop(500)", "junction(2,500,650). signal(2,red).", "junction(2,500,650). signal(2,green)."),
]
AVOIDANCE = [
    Case("follow(7)", "ahead(7,car,200,70).", "meets(7,car,200)."),
    Case("follow(7)", "enters(7,200,70).", "in_lane(left,7,200,300,70)."),
    Case("in_way(7,200,70)", "ahead(7,car,200,70).", "enters(7,200,60)."),
    Case("in_way(7,200,70)", "enters(7,200,70).", "ahead(7,car,200,60)."),
    # 5^2 / (2 x 4.2) = 2.976
    Case("demand(7,29)", "ahead(7,car,50,30).", "ahead(7,car,50,90)."),
    Case("demand(7,99)", "ahead(7,car,8,30).", "ahead(7,car,8,78)."),
    # 8 x (4 + 6) / (20 - 3 - 0.3 x 14) = 6.25
    Case("demand(7,62)", "ahead(7,car,200,-60).", "ahead(7,car,200,60)."),
    Case("demand(7,99)", "ahead(7,car,70,-60).", "ahead(7,car,400,-60)."),
    Case("demand(7,50)", "critical(7,50).", "critical(7,60)."),
]
BRAKING = [
    Case(f"brake({level})", f"critical(7,{least}).", f"critical(7,{least - 1}).")
    for level, least in enumerate((18, 22, 28, 35, 45), start=1)
]
CROSSING = [
    Case("on_foot(7)", crosses(kind="pedestrian"), crosses()),
    Case("on_wheels(7)", crosses(), crosses(kind="pedestrian")),
    Case("gone(7)", crosses(enter=-90, leave=-1), crosses(enter=-90, leave=1)),
    Case("yields(7)", crosses(MUST), crosses(MAY)),
    Case("-yields(7)", crosses(MAY), crosses(MUST)),
    Case("undecided(7)", crosses(), crosses(MAY)),
    Case("undecided(7)", crosses(), crosses(kind="pedestrian")),
    # Priority to the right, although the ego would be there first.
    Case("yields(7)", crosses("from_right(7).", there=25, arrive=18), crosses("", there=25, arrive=18)),
    Case("yields(7)", crosses("", there=17, arrive=18), crosses("", there=19, arrive=18)),
    Case("-yields(7)", crosses("", there=19, arrive=18), crosses("from_right(7).", there=19, arrive=18)),
    Case("hurry(0)", "refused(119).", "refused(180)."),
    Case("hurry(5)", "refused(420).", "refused(400)."),
    Case("hurry(10)", "refused(720).", "refused(719)."),
    Case("margin(7,15,10)", crosses(MUST), crosses(MAY)),
    Case("margin(7,5,3)", crosses(MAY), crosses(MUST)),
    # Somebody 5 m/s faster comes from behind where the ego joins: 2 s and (5 - 2) / 2 s more.
    Case("margin(7,35,10)", crosses(MUST + "merges(7).", pace=130), crosses(MUST, pace=130)),
    Case("margin(7,20,10)", crosses(MUST + "merges(7).", pace=90), crosses(MUST + "merges(7).", pace=130)),
    # After a long wait he may have to brake.
    Case(
        "margin(7,23,7)", crosses(MUST + "merges(7). refused(720).", pace=130), crosses(MUST + "merges(7).", pace=130)
    ),
    Case("same_time(7)", crosses(MUST, there=44), crosses(MUST, there=45, left=60)),
    Case("same_time(7)", crosses(MUST, there=0, left=9), crosses(MUST, there=0, left=8)),
    Case("too_late(7)", crosses(n=47), crosses(n=48)),
    Case("too_late(7)", crosses(n=47), crosses(n=47, kind="pedestrian")),
    Case("patience(7,120)", crosses(MUST), crosses(MAY)),
    Case("patience(7,30)", crosses(MAY), crosses(MUST)),
    Case("stays(7)", crosses(MUST, pace=0) + "standing(121).", crosses(MUST, pace=0) + "standing(120)."),
    Case("stays(7)", crosses(MAY, pace=0) + "standing(31).", crosses(MUST, pace=0) + "standing(31)."),
    Case("doubtful(7)", crosses(MAY, enter=63), crosses(MAY, enter=200)),
    Case("doubtful(7)", crosses(MAY, enter=2, pace=0), crosses(MAY, enter=5, pace=2)),
    # 8^2 / (2 x (10.4 - 2)) = 3.81, where 3.8 is what it is trusted with
    Case("doubtful(7)", crosses(MAY, enter=104), crosses(MAY, enter=105)),
    Case("doubtful(7)", crosses(MAY, enter=15, pace=9), crosses(MAY, enter=15, pace=8)),
    Case("before(7)", crosses(n=3), crosses(n=2)),
    Case("waits(7)", crosses(MUST), crosses(MAY)),
    Case("waits(7)", crosses(MUST), crosses(MUST, there=60, left=90)),
    Case("waits(7)", crosses(MUST), crosses(MUST, n=40)),
    Case("waits(7)", crosses(MAY, enter=60), crosses(MAY, enter=200)),
    Case("waits(7)", crosses(MUST, n=1, enter=100), crosses(MUST, n=1, enter=300), speed=20),
    Case("can_stop(120)", "junction(1,120,300).", "junction(1,100,300)."),
    Case(
        "at_entry(7,120)",
        crosses(MUST, n=200) + "junction(1,120,300).",
        crosses(MUST, n=350) + "junction(1,120,300).",
    ),
    Case("entered(7)", crosses(MUST, n=200) + "junction(1,120,300).", crosses(MUST, n=200)),
    Case(
        "stop(120)",
        crosses(MUST, n=200) + "junction(1,120,300).",
        crosses(MUST, n=200) + "junction(1,120,300). standing(120).",
    ),
    Case("stop(145)", crosses(MUST), crosses(MUST) + "junction(1,120,300)."),
    Case("stop(120)", "races(7). junction(1,120,300).", "races(7). junction(1,120,300). standing(120)."),
    Case("stop(72)", "races(7). junction(1,72,300).", "junction(1,72,300)."),
    Case("stop(72)", "races(7). junction(1,72,300).", "races(7). junction(1,71,300)."),
]
WALKS = {"kind": "pedestrian", "pace": 14, "enter": 20, "leave": 50}
PEDESTRIANS = [
    Case("halts(7)", crosses(**{**WALKS, "pace": 0}), crosses(**WALKS)),
    Case("margin(7,12,6)", crosses(**WALKS), crosses(MUST)),
    Case("yields(7)", crosses(**WALKS), crosses(MAY)),
    Case("waits(7)", crosses(**WALKS), crosses(**{**WALKS, "pace": 0})),
    Case("waits(7)", crosses(**WALKS), crosses(**WALKS, there=80, left=99)),
    Case("waits(7)", crosses(**WALKS, n=1), crosses(**{**WALKS, "enter": 60}, n=1), speed=10),
    Case("stop(145)", crosses(**WALKS), crosses(**WALKS, there=80, left=99)),
    Case("pace(70)", "kerb(7,150).", "kerb(7,150). -crosses(7)."),
    Case("pace(70)", "kerb(7,150).", "kerb(7,200)."),
]
OVERTAKING = [
    Case("stuck(7)", SITE, AHEAD + "stood(7,10). driven(7)."),
    Case("stuck(7)", AHEAD + "stood(7,1). askew(7).", AHEAD + "stood(7,1). askew(7). driven(7)."),
    Case("stuck(7)", PARKED, AHEAD + "stood(7,440)."),
    Case("stuck(7)", AHEAD + "stood(7,600). driven(7).", AHEAD + "stood(7,590). driven(7)."),
    Case("slow(7)", "ahead(7,bicycle,200,40).", "ahead(7,bicycle,200,50)."),
    Case("slows(7)", SITE, AHEAD),
    Case("slows(7)", "ahead(7,bicycle,200,40).", "ahead(7,bicycle,200,60)."),
    Case("queue(7)", PARKED + "junction(1,500,650).", PARKED + "junction(1,600,750)."),
    Case("queue(7)", SITE + "junction(1,330,450).", SITE + "junction(1,345,450)."),
    Case("hidden(7)", SITE + "ahead(8,car,200,60).", SITE + "ahead(8,car,500,60)."),
    Case("obstacle(7)", SITE, SITE + "ahead(8,car,200,60)."),
    Case("obstacle(7)", PARKED, PARKED + "junction(1,400,600)."),
    Case("end(360)", SITE, AHEAD),
    Case("time(90)", SITE, AHEAD),
    Case("occupied(left)", "in_lane(left,8,5,100,80).", "in_lane(left,8,10,100,80)."),
    # 5 m/s faster: 2 + 3 x 0.8 + 3^2 / 6 = 5.9 m
    Case("occupied(left)", "in_lane(left,8,-100,-58,130).", "in_lane(left,8,-100,-59,130)."),
    Case("occupied(left)", SITE + LEFT + "in_lane(left,8,500,590,0).", SITE + LEFT + "in_lane(left,8,520,610,0)."),
    Case(
        "occupied(left)",
        # In 9 s it comes 90 m nearer; the ego needs 48 m.
        SITE + AGAINST + "in_lane(left,8,1370,1460,-100).",
        SITE + AGAINST + "in_lane(left,8,1390,1480,-100).",
    ),
    Case("-occupied(left)", SITE + LEFT, SITE + LEFT + "in_lane(left,8,5,100,80)."),
    Case("-occupied(left)", SITE + LEFT, SITE + LEFT + "sight(500)."),
    Case("-occupied(left)", SITE + AGAINST, SITE + AGAINST + "sight(1300)."),
    Case("better(left)", SITE + LEFT, SITE + AGAINST),
    Case("better(right)", SITE + RIGHT, SITE + RIGHT + "in_lane(right,8,5,100,80)."),
    Case("out", OUT, ""),
    Case("near(7)", SITE, SITE.replace("300", "40")),
    Case("change(left)", SITE + LEFT, SITE + LEFT + OUT),
    Case("change(right)", SITE + RIGHT, SITE + RIGHT + LEFT),
    Case("change(left)", SITE + AGAINST, SITE + AGAINST + RIGHT),
    Case("change(left)", SITE + AGAINST, SITE + AGAINST + "in_lane(left,8,900,990,-100)."),
    Case("ahead_in_own", OUT + "in_lane(own,8,50,200,0).", OUT + "in_lane(own,8,150,300,0)."),
    Case("-occupied(own)", OUT, OUT + "in_lane(own,8,50,200,0)."),
    Case("-occupied(own)", OUT, OUT + "in_lane(own,8,-60,30,80)."),
    Case("change(own)", OUT, OUT + "in_lane(own,8,-60,30,80)."),
    Case("stop(220)", SITE, SITE + LEFT),
    Case("stop(220)", AHEAD + "stood(7,10).", AHEAD + "stood(7,10). driven(7)."),
    Case("parked(7)", AHEAD + "stood(7,10).", AHEAD + "stood(7,10). driven(7)."),
    Case("aloof(7)", AHEAD + "stood(7,10).", AHEAD + "stood(7,10). junction(1,400,600)."),
    Case("aloof(7)", AHEAD + "stood(7,700). driven(7).", AHEAD + "stood(7,500). driven(7)."),
    Case("pace(100)", OUT, ""),
    Case("at_junction", "junction(1,40,200).", "junction(1,50,200)."),
    Case("keep_right", "squeezed.", "squeezed. junction(1,40,200)."),
    Case("keep_right", "squeezed.", "squeezed. " + OUT),
]
ACTIONS = [
    Case("go", "junction(1,200,350). signal(1,green).", "junction(1,200,350). signal(1,red)."),
    Case("go", "ahead(7,car,400,70).", "critical(7,30)."),
    Case("stopping", "junction(1,200,350). signal(1,red).", ""),
    Case("keep_lane", SITE, SITE + LEFT),
    Case("changing", SITE + LEFT, SITE),
]
CASES = [*LIGHTS, *AVOIDANCE, *BRAKING, *CROSSING, *PEDESTRIANS, *OVERTAKING, *ACTIONS]


@pytest.mark.parametrize("case", CASES, ids=[f"{i}-{case}" for i, case in enumerate(CASES)])
def test_a_rule_fires_where_it_must_and_only_there(case: Case) -> None:
    assert case.atom in answer(case.fires, case.speed)
    assert case.atom not in answer(case.holds_not, case.speed)


def test_every_rule_of_the_book_fires_in_a_case_and_not_in_another() -> None:
    fired = [{one.rule.number for one in BOOK.fired(decided(case.fires, case.speed))} for case in CASES]
    untested = [r for r in BOOK.rulebook.rules if r.needs and not any(r.number in some for some in fired)]
    always = [r for r in BOOK.rulebook.rules if r.needs and all(r.number in some for some in fired)]
    assert [f"{rule.place} {rule.text}" for rule in untested + always] == []


# The book as a whole

NUMBERS = st.integers(-200, 2000)
NAMES = {
    "signal": ("red", "yellow", "green"),
    "sign": ("yield", "stop"),
    "lane": ("same", "against"),
    "side": ("left", "right"),
    "kind": ("car", "bicycle", "pedestrian", "static", "emergency"),
}


@st.composite
def moments(draw: st.DrawFn) -> str:
    """Facts as observations may give them, with any numbers."""
    n = lambda: draw(NUMBERS)  # noqa: E731
    pick = lambda what: draw(st.sampled_from(NAMES[what]))  # noqa: E731
    long = st.integers(0, 900)
    out = [f"speed({draw(st.integers(0, 200))}). standing({draw(long)}). refused({draw(long)})."]
    for j in range(1, draw(st.integers(0, 2)) + 1):
        out += [f"junction({j},{n()},{n()}).", f"signal({j},{pick('signal')}).", f"sign({j},{pick('sign')})."]
    for a in range(draw(st.integers(0, 3))):
        out += [f"ahead({a},{pick('kind')},{abs(n())},{n()}).", f"extent({a},{n()}).", f"takes({a},{abs(n())})."]
        out += [f"stood({a},{abs(n())}).", draw(st.sampled_from(("", f"driven({a}).", f"askew({a}).")))]
    for a in range(10, 10 + draw(st.integers(0, 3))):
        out += [f"meets({a},{pick('kind')},{n()}).", f"comes({a},{n()},{n()},{abs(n())})."]
        out += [f"ego_at({a},{n()},{n()}). other_at({a},{n()},{n()})."]
        out += [draw(st.sampled_from(("", f"right_of_way({a}).", f"-right_of_way({a}).", f"from_right({a}).")))]
    for side in draw(st.sets(st.sampled_from(("left", "right")))):
        out += [f"lane({side},{pick('lane')}). in_lane({side},3,{n()},{n()},{n()})."]
    out += draw(st.sampled_from(([], ["aside(left).", f"in_lane(own,4,{n()},{n()},{n()})."])))
    out += draw(st.sampled_from(([], [f"critical(0,{abs(n())})."])))
    return " ".join(out)


@settings(max_examples=60)
@given(moments())
def test_there_is_always_one_answer_that_says_where_to_drive_and_how_fast(text: str) -> None:
    actions = {str(atom) for atom in decided(text).actions}
    stopping = any(action.startswith(("stop(", "brake(")) for action in actions)
    changing = [action for action in actions if action.startswith("change(")]
    assert ("go" in actions) is not stopping
    assert len(changing) <= 1
    assert ("keep_lane" in actions) is not bool(changing)


@settings(max_examples=30)
@given(moments())
def test_what_is_not_grounded_would_not_have_fired(text: str) -> None:
    decision = decided(text)
    always = {rule.text.rstrip(".") for rule in BOOK.rulebook.rules if ":-" not in rule.text}
    fired = {one.atom for one in BOOK.fired(decision)}
    assert {str(atom) for atom in decision.answer} == fired | always
