from __future__ import annotations

import csv
import io
import math
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dohyo.evaluation.records.specifications import InfractionKind
from dohyo.service.evaluations.metrics import as_csv, as_document
from dohyo.service.monitoring.prometheus import Family, Sample, exposition
from dohyo.sumo_networks.errors import InvalidInputError
from tests.evaluation.builders import ego, episode, infraction
from tests.service.evaluations.test_scoring import drives_of, entry

HIT = infraction(InfractionKind.COLLISION_VEHICLE, route_m=50.0)
UNESCAPED = {"\\\\": "\\", '\\"': '"', "\\n": "\n"}
Samples = dict[tuple[str, frozenset[tuple[str, str]]], float]


def parse(text: str) -> tuple[dict[str, str], Samples]:
    """Types by family, and values by name and labels, of the text format; every line must be one of three kinds."""
    types: dict[str, str] = {}
    samples: Samples = {}
    assert text.endswith("\n")
    for line in text[:-1].split("\n"):
        if line.startswith("# HELP "):
            continue
        if line.startswith("# TYPE "):
            _, _, name, kind = line.split(" ")
            assert name not in types
            types[name] = kind
            continue
        match = re.fullmatch(r"([a-zA-Z_:][\w:]*)(?:\{(.*)\})? (\S+)", line)
        assert match, line
        pairs = re.findall(r'([a-zA-Z_]\w*)="((?:[^"\\]|\\.)*)"(?:,|$)', match[2] or "")
        labels = frozenset((key, re.sub(r"\\.", lambda m: UNESCAPED[m[0]], value)) for key, value in pairs)
        assert (match[1], labels) not in samples
        samples[match[1], labels] = float(match[3])
    return types, samples


def test_lost_drives_count_as_zero_beside_the_means_that_leave_them_out() -> None:
    drives = drives_of(episode(ego(), cell="town"))
    whole, without = as_document(entry("a", drives, lost={"town": 1, "gone": 2})), as_document(entry("a", drives))
    assert (without["all"]["lost"], without["all"]["scores_lost_as_zero"]) == (0, None)
    assert (whole["all"]["lost"], whole["cells"]["town"]["lost"], whole["cells"]["gone"]["lost"]) == (3, 1, 2)
    assert whole["all"]["scores"] == without["all"]["scores"]
    as_zero = [whole[part]["scores_lost_as_zero"] for part in ("all",)]
    as_zero += [whole["cells"][cell]["scores_lost_as_zero"] for cell in ("town", "gone")]
    assert [one["route_completion"]["mean"] for one in as_zero] == [20.0, 40.0, 0.0]


def test_the_text_format() -> None:
    family = Family(
        "dohyo_episodes", "By status.\nSecond \\ line", "gauge", (Sample(3, {"status": "done"}), Sample(1.5))
    )
    assert exposition([family]) == (
        "# HELP dohyo_episodes By status.\\nSecond \\\\ line\n"
        "# TYPE dohyo_episodes gauge\n"
        'dohyo_episodes{status="done"} 3.0\n'
        "dohyo_episodes 1.5\n"
    )


@given(st.dictionaries(st.from_regex(r"[a-z_][a-z0-9_]{0,5}", fullmatch=True), st.text(max_size=8)), st.floats())
def test_any_label_and_value_come_back(labels: dict[str, str], value: float) -> None:
    types, samples = parse(exposition([Family("a_total", "help", "counter", (Sample(value, labels),))]))
    assert types == {"a_total": "counter"}
    ((key, found),) = samples.items()
    assert key == ("a_total", frozenset(labels.items()))
    assert found == value or (math.isnan(found) and math.isnan(value))


def test_a_summary_has_its_sum_and_count() -> None:
    samples = (Sample(0.5, {"quantile": "0.5"}), Sample(10.0, suffix="_sum"), Sample(4, suffix="_count"))
    _, found = parse(exposition([Family("step_seconds", "Steps.", "summary", samples)]))
    assert found["step_seconds_count", frozenset()] == 4


def test_a_wrong_name_is_refused() -> None:
    with pytest.raises(InvalidInputError, match="metric's name"):
        exposition([Family("a b", "", "gauge", ())])
    with pytest.raises(InvalidInputError, match="label's name"):
        exposition([Family("a", "", "gauge", (Sample(1, {"of it": "x"}),))])


def test_csv_has_a_row_per_drive_one_per_cell_and_one_for_all() -> None:
    records = [
        episode(ego(HIT, HIT), name="a", cell="town"),
        episode(ego(progress_m=400.0), name="b", cell="town"),
        episode(ego(progress_m=200.0), name="c", cell="country"),
    ]
    drives = [drive for number, record in enumerate(records) for drive in drives_of(record, f"ep{number}")]
    table = list(csv.DictReader(io.StringIO(as_csv(entry("a", drives)))))
    assert [(line["row"], line["cell"], line["scenario"]) for line in table] == [
        ("drive", "town", "a"),
        ("drive", "town", "b"),
        ("drive", "country", "c"),
        ("cell", "town", ""),
        ("cell", "country", ""),
        ("all", "", ""),
    ]
    assert [float(line["driving_score"]) for line in table] == pytest.approx([28.8, 40.0, 20.0, 34.4, 20.0, 88.8 / 3])
    assert [int(line["collision_vehicle"]) for line in table] == [2, 0, 0, 2, 0, 2]
    assert [float(line["km"]) for line in table] == pytest.approx([0.8, 0.4, 0.2, 1.2, 0.2, 1.4])
    assert (table[0]["driving_score_low"], table[0]["drives"], table[5]["drives"]) == ("", "1", "3")
    low, high = float(table[3]["driving_score_low"]), float(table[3]["driving_score_high"])
    assert low == pytest.approx(28.8)
    assert high == pytest.approx(40.0)


def test_the_document_holds_cells_and_drives() -> None:
    drives = drives_of(episode(ego(HIT), cell="town"), "ep1") + drives_of(episode(ego(), cell="country"), "ep2")
    document = as_document(entry("a", drives))
    assert list(document["cells"]) == ["town", "country"]
    assert document["cells"]["town"]["scores"]["driving_score"]["mean"] == pytest.approx(48.0)
    assert document["all"]["scores"]["driving_score"]["mean"] == pytest.approx(64.0)
    assert [drive["episode"] for drive in document["drives"]] == ["ep1", "ep2"]


def test_an_evaluation_without_a_finished_episode_has_empty_metrics() -> None:
    assert as_document(entry("a", []))["all"]["scores"]["driving_score"] == {
        "mean": None,
        "low": None,
        "high": None,
        "n": 0,
    }
    assert as_csv(entry("a", [])).count("\n") == 2
