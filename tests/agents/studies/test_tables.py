"""RESULTS.md: sections are replaced between their marks, and hold what their stored rows give."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path

import pytest

from dohyo.agents.studies import __main__ as command
from dohyo.agents.studies.__main__ import main, sections
from dohyo.agents.studies.claims import Claim, judge
from dohyo.agents.studies.registry import studies, study_named
from dohyo.agents.studies.rows import Row
from dohyo.agents.studies.runner import Job
from dohyo.agents.studies.study import read_results
from dohyo.agents.studies.tables import claims_table, probability, write_section
from dohyo.sumo_networks.config import Config
from dohyo.sumo_networks.errors import InvalidInputError, UnknownNameError

TEXT = "before\n<!-- begin a -->\nold\n<!-- end a -->\nbetween\n<!-- begin b -->\nkept\n<!-- end b -->\nafter\n"
NO_ROWS = "*No rows yet.*"
LINE = '{"arm": "rules", "training_seed": null, "benchmark": "elsewhere", "scenario": "m01", "seed": 0}\n'
UNSTORED = "**The rows of the tables below are not stored**"


def test_one_section_is_replaced_and_the_rest_stays(tmp_path: Path) -> None:
    page = tmp_path / "RESULTS.md"
    page.write_text(TEXT)
    write_section(page, "a", "new\n")
    assert page.read_text() == TEXT.replace("old", "new")


@pytest.mark.parametrize("damaged", ["", "<!-- begin a -->\nold\n", "<!-- end a -->\n<!-- begin a -->\n"])
def test_a_page_without_both_marks_is_refused_and_left_alone(tmp_path: Path, damaged: str) -> None:
    page = tmp_path / "RESULTS.md"
    page.write_text(damaged)
    with pytest.raises(InvalidInputError, match="expected the marks <!-- begin a -->"):
        write_section(page, "a", "new")
    assert page.read_text() == damaged


@pytest.mark.slow
@pytest.mark.parametrize("name", studies())
def test_every_section_holds_what_its_stored_rows_give(name: str) -> None:
    study = study_named(name)
    results, page = study.read(study.stored), study.page.read_text()
    for section, table in sections(name, study).items():
        found = re.search(rf"<!-- begin {section} -->\n(.*?)\n<!-- end {section} -->", page, re.S)
        assert found, f"{study.page} has no section {section}"
        told = (table(results) if results.rows else "") or NO_ROWS
        assert found[1] == told or (not results.rows and UNSTORED in page[: found.start()])


def test_a_claim_of_few_trainings_is_not_resolved_and_says_why() -> None:
    def table(seeds: range | tuple[None]) -> str:
        rows = {
            arm: {(f"m{i}",): dict.fromkeys(seeds, base + i) for i in range(20)} for arm, base in (("a", 9), ("b", 1))
        }
        judged = judge([Claim("a", ">", "b", "score")], lambda claim, arm: rows[arm])
        return claims_table(judged, ("claim", "each training")).splitlines()[-1]

    difference = "8.00 [8.00, 8.00]"
    assert table(range(3)) == f"| a > b | +8, +8, +8 | {difference} n=60 | < 0.001 | reproduced |"
    assert table(range(1)) == f"| a > b | +8 | {difference} n=20 | — | not resolved: 1 training |"
    assert table(range(2)).endswith("| — | not resolved: 2 trainings |")
    assert table((None,)) == f"| a > b | +8 | {difference} n=20 | < 0.001 | reproduced |"


def test_a_claim_of_few_scenarios_says_that_nothing_could_resolve_it() -> None:
    rows = {arm: {(f"m{i}",): dict.fromkeys(range(3), base) for i in range(4)} for arm, base in (("a", 9), ("b", 1))}
    judged = judge([Claim("a", ">", "b", "score")], lambda claim, arm: rows[arm])
    line = claims_table(judged, ("claim",)).splitlines()[-1]
    assert line.endswith("| — | not resolved: 4 scenarios |")


def test_p_values_have_two_digits_that_count() -> None:
    assert [probability(p) for p in (0.0004, 0.001, 0.0494, 0.1, 1.0)] == ["< 0.001", "0.001", "0.049", "0.10", "1.00"]


def test_a_p_value_below_the_level_is_not_told_as_the_level() -> None:
    told = [probability(p) for p in (0.0495, 0.0498046875, 0.04999, 0.05, 0.0504)]
    assert told == ["0.0495", "0.0498", "0.0499", "0.050", "0.050"]


@pytest.mark.parametrize("action", ["table", "figures"])
def test_an_installed_dohyo_says_where_the_stored_rows_are(
    action: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    installed = {name: replace(study_named(name), room=tmp_path / name) for name in ("ghrl", "ghrl-trainings")}
    monkeypatch.setattr(command, "study_named", installed.__getitem__)
    monkeypatch.setattr(command, "studies", lambda: installed)
    for name in installed:
        with pytest.raises(InvalidInputError, match=r"found none; they are in dohyo's repository only.* --rows FOLDER"):
            main([name, action])
        with pytest.raises(InvalidInputError, match=r"expected stored rows, found none$"):
            main([name, action, "--rows", str(tmp_path / "nothing")])
    main(["all", action])
    assert capsys.readouterr().out.count("no stored rows; they are in dohyo's repository only") == len(installed)


def test_the_command_lists_the_studies_and_prints_one_section(capsys: pytest.CaptureFixture[str]) -> None:
    main([])
    assert [line.split()[0] for line in capsys.readouterr().out.splitlines()] == list(studies())
    planners = study_named("planners")
    main(["planners", "table", "--section", "planner-causes"])
    assert capsys.readouterr().out == f"{planners.tables['planner-causes'](planners.read(planners.stored))}\n\n"
    with pytest.raises(UnknownNameError, match="no study named 'ghlr'; did you mean 'ghrl'"):
        main(["ghlr", "table"])


@pytest.mark.parametrize("option", ["--arms", "--trainings", "--only"])
@pytest.mark.parametrize("action", ["table", "figures"])
def test_a_table_is_of_all_rows_since_its_claims_are_corrected_together(action: str, option: str) -> None:
    with pytest.raises(InvalidInputError, match=f"{option}: expected with 'run', got '{action}'"):
        main(["ghrl", action, option, "0"])


def test_arms_and_trainings_that_are_not_there_are_named_and_nothing_runs(tmp_path: Path) -> None:
    for arm, training, said in (("nobody", "0", "no arm .*'nobody'"), ("ghrl", "7", r"no training .*'7' \(there is 0")):
        with pytest.raises(InvalidInputError, match=said):
            main(["ghrl", "run", "--arms", "hrl", arm, "--trainings", training, "--out", str(tmp_path / "out")])
    assert not (tmp_path / "out").exists()


def test_a_choice_without_cells_and_rows_that_are_not_there_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InvalidInputError, match="without cells"):
        main(["ghrl", "run", "--only", "nowhere", "--out", str(tmp_path)])
    with pytest.raises(InvalidInputError, match="expected stored rows, found none"):
        main(["ghrl", "table", "--rows", str(tmp_path)])


def test_the_tables_of_all_studies_leave_a_page_without_stored_rows_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(command, "studies", lambda: {"dissipation": studies()["dissipation"]})
    before = study_named("dissipation").page.read_text()
    main(["all", "table", "--rows", str(tmp_path), "--write"])
    assert study_named("dissipation").page.read_text() == before
    assert capsys.readouterr().out == "dissipation: no stored rows\n"


def test_rows_of_other_options_are_refused(tmp_path: Path) -> None:
    (tmp_path / "facts.json").write_text('{"options": {"runs": "elsewhere"}}')
    (tmp_path / "rows.jsonl").write_text(LINE)
    with pytest.raises(InvalidInputError, match=r"has rows of other options: expected {'runs': 'elsewhere'}"):
        main(["ghrl", "run", "--arms", "rules", "--only", "precrash", "--out", str(tmp_path)])


def test_options_of_a_call_that_made_no_row_bind_no_later_one(tmp_path: Path) -> None:
    study = study_named("ghrl")
    with pytest.raises(InvalidInputError, match="stopped"):
        replace(study, work=stopped).run(tmp_path, ["runs=mistyped"], chosen=lambda cell: cell.arm == "rules")
    replace(study, work=one_row).run(tmp_path, ["runs=right"], chosen=lambda cell: cell.arm == "rules")
    facts = read_results(tmp_path).facts
    assert (facts["options"], len(facts["sessions"])) == ({"runs": "right"}, 1)


def test_rows_of_another_version_are_told_and_not_gone_on_with(tmp_path: Path) -> None:
    study = replace(study_named("ghrl"), work=one_row)
    study.run(tmp_path, chosen=lambda cell: cell.arm == "rules")
    facts = tmp_path / "facts.json"
    facts.write_text(facts.read_text().replace(f'"dohyo": "{version("dohyo")}"', '"dohyo": "0.0.1"'))
    assert "made with dohyo 0.0.1." in sections("ghrl", study)["rows of ghrl"](read_results(tmp_path))
    with pytest.raises(InvalidInputError, match=rf"has rows of dohyo 0\.0\.1: expected {version('dohyo')}"):
        study.run(tmp_path, chosen=lambda cell: cell.arm == "rules")
    (tmp_path / "rows.jsonl").unlink()  # a session that made none
    for _ in range(2):
        study.run(tmp_path, chosen=lambda cell: cell.arm == "rules")
    assert read_results(tmp_path).versions == [version("dohyo")]


def test_rows_from_before_there_was_an_option_had_its_default(tmp_path: Path) -> None:
    sessions = [{"versions": {"dohyo": version("dohyo")}}]
    (tmp_path / "facts.json").write_text(json.dumps({"options": {}, "sessions": sessions}))
    (tmp_path / "rows.jsonl").write_text(LINE)
    study = replace(study_named("ghrl"), work=one_row)
    with pytest.raises(InvalidInputError, match="has rows of other options"):
        study.run(tmp_path, ["runs=elsewhere"], chosen=lambda cell: cell.arm == "rules")
    study.run(tmp_path, chosen=lambda cell: cell.arm == "rules")
    assert read_results(tmp_path).facts["options"] == {"runs": "runs/study"}


def test_facts_hold_the_options_and_the_commit_of_every_session(tmp_path: Path) -> None:
    study = replace(study_named("ghrl"), work=one_row, prepare=lambda options, cells, workers: None)
    for count in (1, 2):
        study.run(tmp_path, ["runs=somewhere"], chosen=lambda cell: cell.arm == "rules")
        facts = read_results(tmp_path).facts
        assert facts["options"] == {"runs": "somewhere"}
        assert len(facts["sessions"]) == count
        assert {"commit", "command", "versions"} <= set(facts["sessions"][0])


def test_a_study_that_is_stopped_keeps_the_facts_of_earlier_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    study = replace(
        study_named("ghrl"),
        work=one_row,
        prepare=lambda options, cells, workers: None,
        facts=lambda options: {"stretches": 12},
        tables={"stretches": lambda results: f"{results.facts['stretches']} stretches"},
        judged=lambda results: (),
    )
    study.run(tmp_path, chosen=lambda cell: cell.arm == "rules")
    with pytest.raises(InvalidInputError, match="stopped"):
        replace(study, work=stopped).run(tmp_path)
    facts = read_results(tmp_path).facts
    assert (facts["stretches"], len(facts["sessions"])) == (12, 2)
    monkeypatch.setattr(command, "study_named", lambda name: study)
    main(["ghrl", "table", "--rows", str(tmp_path)])
    assert "12 stretches" in capsys.readouterr().out


def stopped(options: Config, job: Job) -> list[Row]:
    raise InvalidInputError("stopped")


def one_row(options: Config, job: Job) -> list[Row]:
    return [{**cell._asdict(), "success": True} for cell in job]
