"""The tables of GHRL's drives, from hand-made rows."""

from __future__ import annotations

from dohyo.agents.hierarchical.study import tables
from dohyo.agents.studies.crossed_bootstrap import difference, estimate
from dohyo.agents.studies.study import Results
from dohyo.evaluation.statistics import share_estimate
from tests.agents.hierarchical.drives import a_drive, drives_of


def rows(table: str) -> list[list[str]]:
    return [line.strip("| ").split(" | ") for line in table.splitlines()[2:]]


def test_failures_are_counted_by_the_first_collision_or_by_the_ending():
    drives = [
        a_drive(),
        a_drive(success=False, status="failed: collision", infractions=["red_light", "collision_pedestrian"]),
        a_drive(success=False, status="failed: agent got blocked"),
        a_drive(success=False, status="lost: traffic was gridlocked", infractions=["red_light"]),
    ]
    assert tables.failures(drives) == {"pedestrian hit": 1, "got blocked": 1}
    told = "1 pedestrian hit, 1 got blocked"
    assert rows(tables.failure_table(drives, ["rules"])) == [["precrash", "rules", "3", told, "1", "33.3 (1)", "1"]]


def test_a_success_with_a_red_light_is_not_lawful():
    drives = [a_drive(), a_drive(infractions=["red_light"])]
    assert rows(tables.failure_table(drives, ["rules"])) == [["precrash", "rules", "2", "none", "1", "50.0 (1)", "0"]]


def test_of_one_training_success_has_wilsons_interval_over_drives_that_were_not_lost():
    gone = a_drive(arm="ghrl", scenario="m9", status="lost: simulation failed")
    drives = [*drives_of("ghrl", {0: [1, 1, 0, 1]}), gone]
    found = estimate(
        tables.percent(drives, "ghrl", "success"), lambda values: share_estimate([value > 0 for value in values])
    )
    assert found == share_estimate([True, True, False, True])


def test_drives_that_all_ended_alike_are_as_many_as_their_scenarios():
    table = tables.success_table(drives_of("ghrl", {seed: [1] * 10 for seed in range(3)}), ["ghrl"])
    low = share_estimate([True] * 10).low
    assert rows(table) == [["precrash: a", f"100 [{low:.1f}, 100] n=30"]]


def test_the_success_table_has_a_row_per_cell_or_kind_of_event_and_arms_in_order():
    drives = [
        *drives_of("ghrl", {0: [1, 1], 1: [1, 0]}, cell="oncoming.town", event="oncoming"),
        *drives_of("ghrl", {0: [0, 0], 1: [1, 0]}, cell="oncoming.city", event="oncoming"),
        *drives_of("rules", {None: [1, 1]}, cell="town.empty", benchmark="nocrash"),
    ]
    table = tables.success_table(drives, ["rules", "ghrl"])
    assert table.splitlines()[0] == "| NoCrash success, % | rules | ghrl |"
    first, second = rows(table)  # none over all: the two arms have no scenario in common
    assert first[:2] == ["precrash: oncoming", "\N{EM DASH}"]
    assert first[2].startswith("50.0 [")
    assert first[2].endswith("n=8")
    assert second == ["nocrash: town.empty", "100 [34.2, 100] n=2", "\N{EM DASH}"]


def test_rows_compare_the_scenarios_that_all_trainings_drove_and_all_arms_where_they_are_of_all_cells():
    hard, easy = [1, 0] * 4, [1] * 90
    drives = [
        *drives_of("ghrl-r", dict.fromkeys(range(3), hard), cell="dense"),
        *drives_of("ghrl-r", {0: easy}, cell="empty"),  # only training 0
        *drives_of("ghrl", dict.fromkeys(range(3), hard), cell="dense"),
        *drives_of("rules", {None: hard[:6]}, cell="dense"),
    ]
    found = {name: told for name, *told in rows(tables.success_table(drives, ["ghrl-r", "ghrl", "rules"]))}
    dense, whole = found["precrash, all"], found["precrash, all: all drives of training 0"]
    assert dense[0] == dense[1]  # as the arms do not differ
    assert dense[0].endswith("n=18 (50, 50, 50)")  # the rules drove six scenarios
    assert dense[2].startswith("50.0 [")
    assert whole[0].startswith("95.9 [")
    assert whole[0].endswith("n=98")
    assert whole[1:] == ["\N{EM DASH}"] * 2
    assert found["precrash: dense"][0].endswith("n=24")
    assert found["precrash: empty"][0].endswith("n=90")
    assert len(found) == 4


def test_long_drives_are_told_by_2500_m_before_any_collision():
    far = [(True, False), (True, True), (None, False)]
    drives = [a_drive(scenario=f"m{i}", success=done, drove_2500m=m) for i, (m, done) in enumerate(far)]
    name, told = rows(tables.success_table(drives, ["rules"]))[-1]
    assert name == "2500 m before any collision"
    assert told.startswith("100 [")
    assert told.endswith("n=2")
    assert "2500 m" not in tables.success_table([a_drive()], ["rules"])


def test_time_under_rules_is_weighed_by_duration_and_only_watched_drives_count():
    drives = [
        a_drive(critical_share=0.5, longest_standing_s=4.0, deadlock=False),
        a_drive(critical_share=0.0, longest_standing_s=31.5, deadlock=True, duration_s=30.0),
        a_drive(critical_share=1.0, longest_standing_s=99.0, deadlock=True, status="lost: simulation failed"),
        a_drive(arm="autopilot"),
    ]
    assert rows(tables.rules_table(drives, ["rules", "autopilot"])) == [["precrash", "rules", "12.5", "31.5", "1 of 2"]]
    assert tables.rules_table(drives, ["autopilot"]) == ""


def test_arms_are_paired_by_scenario_and_training():
    drives = [
        *drives_of("ghrl-r", {0: [1, 1, 1], 1: [1, 1, 0]}),
        *drives_of("ghrl", {0: [1, 0, 0], 1: [0, 1]}),
        *drives_of("rules", {None: [1, 1, 1, 0]}),
    ]
    ghrl_r, ghrl, rules = (tables.percent(drives, arm, "success") for arm in ("ghrl-r", "ghrl", "rules"))
    by_key = difference(ghrl_r, ghrl)
    assert [by_key[("precrash", f"m{i}", 0)] for i in range(3)] == [{0: 0.0, 1: 100.0}, {0: 100.0, 1: 0.0}, {0: 100.0}]
    against_one = difference(ghrl_r, rules)
    assert against_one[("precrash", "m2", 0)] == {0: 0.0, 1: -100.0}
    assert ("precrash", "m3", 0) not in against_one


def test_a_claim_is_judged_over_all_benchmarks_and_in_each():
    scenarios = 12
    drives = [
        *drives_of("ghrl", {seed: [1] * scenarios for seed in range(3)}),
        *drives_of("hrl", {seed: [0] * 10 + [1] * 2 for seed in range(3)}),
        *drives_of("ghrl", {0: [1, 0]}, benchmark="nocrash"),
        *drives_of("hrl", {0: [0, 1]}, benchmark="nocrash"),
    ]
    every, precrash, nocrash = rows(tables.claim_table(drives))
    assert every[:2] == ["ghrl > hrl", "all"]
    assert precrash[1:3] == ["precrash", "+83, +83, +83"]
    assert precrash[3].startswith("83.3 [")
    assert precrash[4:] == ["0.006", "reproduced"]
    assert nocrash[1:] == ["nocrash", "+0", "0 [-100, 100] n=2", "—", "not resolved: 1 training"]
    assert tables.claim_table(drives_of("ghrl", {0: [1]})) == ""


def test_lawful_success_stands_beside_success_where_a_red_light_was_run():
    drives = [*drives_of("ghrl", {None: [1, 1, 0]}), a_drive(arm="ghrl", scenario="m3", infractions=["red_light"])]
    assert not tables.is_lawful(a_drive(infractions=["stop_sign"]))
    assert tables.is_lawful(a_drive(infractions=["minimum_speed"]))
    success, lawful = rows(tables.success_table(drives, ["ghrl"]))
    assert success[1].startswith("75.0 [")
    assert lawful[0] == "precrash, all, no red light or stop sign run either"
    assert lawful[1].startswith("50.0 [")


def test_a_section_has_its_arms_and_seed_alone():
    drives = [a_drive(), a_drive(arm="ghrl"), a_drive(arm="hrl"), a_drive(arm="ghrl", seed=1, success=False)]
    head, row = tables.arms_section("ghrl", "rules")(Results(drives, {})).splitlines()[:3:2]
    assert head == "| NoCrash success, % | ghrl | rules |"
    assert row == "| precrash: a | 100 n=1 | 100 n=1 |"
    assert "| precrash: a | 0 n=1 |" in tables.unseen_section(Results(drives, {}))


def test_arms_that_never_drove_have_no_column_and_empty_tables_are_left_out():
    text = tables.tables(drives_of("autopilot", {None: [1, 0]}), ["rules", "autopilot"])
    assert [block.splitlines()[0] for block in text.split("\n\n")] == [
        "| NoCrash success, % | autopilot |",
        "| benchmark | arm | drives | failures | red lights run | lawful success, % | lost, not counted |",
    ]


def test_two_arms_that_differ_by_a_setting_are_told_with_their_paired_difference():
    section = tables.lines_section("ghrl-r-lines", "ghrl-r-no-lines")
    mine = drives_of("ghrl-r-lines", {0: [1, 1, 1, 0]})
    other = [
        {**row, "infractions": ["red_light"] if number < 2 else []}
        for number, row in enumerate(drives_of("ghrl-r-no-lines", {0: [1, 1, 1, 0]}))
    ]
    found = section(Results([*mine, *other], {}))
    success, lawful = rows(found[found.index("| paired difference") :])
    assert success == ["NoCrash success, ghrl-r-lines less ghrl-r-no-lines", "0 [0, 0] n=4"]
    assert lawful[1].startswith("50.0 [")
    assert section(Results(mine, {})) == ""
