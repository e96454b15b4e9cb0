"""`dohyo report`, `dohyo verify`, `dohyo score`: comparison, replay check and rescoring of records."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from dohyo.evaluation.episode.guarded_agent import ACT_DEADLINE_S
from dohyo.evaluation.episode.runner import drive_episode
from dohyo.evaluation.freeway.day import DayRecord, is_day
from dohyo.evaluation.freeway.morning import MorningRecord, is_morning
from dohyo.evaluation.freeway.page import PAGE
from dohyo.evaluation.freeway.records import facts_at
from dohyo.evaluation.freeway.result import RESULT
from dohyo.evaluation.parking.lot_files import is_lot, is_lots_folder, read_lot, read_lot_motion
from dohyo.evaluation.parking.motion import MOTION, read_motion_file
from dohyo.evaluation.parking.record import RECORDS, is_parking_records, read_records
from dohyo.evaluation.records.mixed import agents_of, drives_of
from dohyo.evaluation.records.record import EpisodeRecord
from dohyo.evaluation.records.signature import Sealed
from dohyo.evaluation.records.specifications import Status
from dohyo.evaluation.records.store import read_record, read_trajectory, read_whole_record
from dohyo.evaluation.report.contenders import Pair, make_contenders, make_pairs
from dohyo.evaluation.report.page import write_report
from dohyo.evaluation.report.recorded_versions import mixed_versions
from dohyo.evaluation.report.style import probability
from dohyo.evaluation.running.manifest import MANIFEST, part_of_record
from dohyo.evaluation.running.membership import benchmark_of_record, check_members
from dohyo.evaluation.running.run import read_result
from dohyo.evaluation.scores.driving import IrsLength, Rules
from dohyo.evaluation.scores.nuplan.summary import applies, lost_drives, score_records
from dohyo.evaluation.scores.nuplan.summary import as_document as closed_loop_document
from dohyo.evaluation.summary import SCORES, Summary, common_drives, score_drive, summarise, summarise_cells
from dohyo.service.cli.by_agent import evaluations_of
from dohyo.service.cli.closed_loop import print_closed_loop, print_legend, print_terms
from dohyo.service.cli.commands.parking import drive_lots_again, report_parking, verify_parking
from dohyo.service.cli.commands.signatures import Key, SignatureOnly, SignedBy, Signer, check_signature
from dohyo.service.cli.mixed import print_meetings, scores_document
from dohyo.service.cli.output import (
    Json,
    console,
    interval,
    number,
    print_cells,
    print_comparison,
    print_json,
    print_part,
    print_rows,
)
from dohyo.service.cli.trust import Policy, Trust, check_networks, check_trusted, trusted_agents
from dohyo.service.episodes.recorded_agents import close_all
from dohyo.sumo_networks.errors import InvalidInputError

RulesOption = Annotated[
    Literal["1.0", "2.0", "2.1"] | None,
    typer.Option(help="CARLA Leaderboard rules of the score; default: those of the benchmark."),
]
IrsOption = Annotated[Literal["completed", "driven", "route"], typer.Option(help="Distance by which IRS is divided.")]
DeadlineOption = Annotated[float, typer.Option(min=0.1, help="Seconds an agent may take to decide.")]
DIFFERS = 1


def report(
    folders: Annotated[list[Path], typer.Argument(help="Result folders of dohyo evaluate.")],
    out: Annotated[Path, typer.Option(help="The HTML file to write.")] = Path("report.html"),
    rules: RulesOption = None,
    irs_length: IrsOption = "completed",
) -> None:
    """Compares evaluations: a table here, and one self-contained HTML file."""
    for folder in folders:
        _check_reportable(folder)
    parking = [is_parking_records(folder) or is_lots_folder(folder) for folder in folders]
    if any(parking):
        if not all(parking):
            raise InvalidInputError("these folders hold evaluations of driving and of parking; compare one at a time")
        report_parking(folders, out)
        return
    results = [read_result(folder) for folder in folders]
    benchmarks = {result.manifest.benchmark_sha256 for result in results}
    if len(benchmarks) > 1:
        raise InvalidInputError(f"these folders hold {len(benchmarks)} different benchmarks; compare one at a time")
    rules = rules or results[0].manifest.benchmark.rules
    evaluations = evaluations_of(results)
    contenders = make_contenders(evaluations, rules, irs_length)
    print_comparison([replace(one.summary, agent=one.name) for one in contenders])
    for one in evaluations:
        print_cells(summarise_cells(one.records, rules=rules, irs_length=irs_length), of=one.agent)
    closed_loop = {one.name: one.closed_loop.summary for one in contenders if one.closed_loop}
    if closed_loop:
        print_closed_loop(closed_loop, "agent")
        print_legend()
    pairs = make_pairs(contenders)
    for pair in pairs:
        console.print(_verdict(pair))
    print_meetings([record for result in results for record in result.records])
    for one in evaluations:
        print_part(one.part, f"{one.agent}: ")
    _print_mixed_versions(mixed_versions([(one.agent, one.records) for one in evaluations]))
    path = write_report(contenders, pairs, out)
    console.print(f"report: {path.resolve()}")


def _check_reportable(folder: Path) -> None:
    """Checks that a result folder is not one of freeway mornings or of days of forecasts.

    Raises:
        InvalidInputError: It is.
    """
    if (folder / RESULT).is_file():
        raise InvalidInputError(f"'{folder}': a result on the freeway, whose report is '{folder / PAGE}'")
    if not (folder / MANIFEST).is_file():
        return
    benchmark = facts_at(folder / MANIFEST).get("benchmark")
    kind = benchmark.get("kind") if isinstance(benchmark, Mapping) else None
    if what := {"traffic": "mornings on the freeway", "forecast": "days of forecasts"}.get(str(kind)):
        raise InvalidInputError(
            f"'{folder}': an evaluation of {what}; it has no drives on roads, of which reports are made: "
            f"`dohyo evaluations watch ID` prints the scores"
        )


def _verdict(pair: Pair) -> str:
    """Comparison by the headline: "a > b: driving score differs by 9.10 [3.00, 15.0] on 75 common drives, P(a > b)"."""
    a, b = pair.a, pair.b
    if not (common := common_drives(a.evaluation.records, b.evaluation.records)):
        return f"{a.name} and {b.name} have no common drive: same scenario, seed and ego"
    if pair.reason:
        return f"{a.name} and {b.name} are not compared: {pair.reason}"
    found, score = pair.headline, a.evaluation.headline.label
    n = found.difference.n
    drives = _counted(common, "common drive") + ("" if n == common else f" in {_counted(n, 'episode')}")
    chance = probability(found.probability, a.name, b.name)
    return f"{a.name} {found.verdict} {b.name}: {score} differs by {interval(found.difference)} on {drives}, {chance}"


def _counted(n: int, what: str) -> str:
    return f"{n} {what}{'s' * (n != 1)}"


def verify(
    record: Annotated[Path, typer.Argument(help="A record, NAME.json; of parking: records.jsonl.")],
    key: Key = None,
    server: SignedBy = None,
    signature_only: SignatureOnly = False,
    policy: Policy = None,
    trust: Trust = False,
    deadline: DeadlineOption = ACT_DEADLINE_S,
    json: Json = False,
) -> None:
    """Checks a record's signature and benchmark, drives the episode again and compares.

    Exit code 1 if the hashes differ, 2 if the scenario is not that of the benchmark that the record names.
    """
    if deadline != ACT_DEADLINE_S and (is_day(record) or is_morning(record)):
        raise InvalidInputError(f"'{record}': --deadline is for records of drives and lots")
    if is_parking_records(record):
        if key or server or signature_only or policy:
            raise InvalidInputError(f"'{record}': records of parking are not signed: expected no option but --trust")
        _check_motion(record)
        verify_parking(record, trust, json, deadline)
        return
    if is_lot(record):
        _verify_lot(record, key, server, signature_only, policy, trust, json, deadline)
        return
    if is_morning(record):
        if policy is not None:
            raise InvalidInputError(f"'{record}': --policy is for records of drives, lots and days")
        _verify_morning(record, key, server, signature_only, json)
        return
    if is_day(record):
        _verify_day(record, key, server, signature_only, policy, trust, json)
        return
    old = read_record(record)
    signer = check_signature(record, old, key, server)
    read_trajectory(record)
    benchmark = benchmark_of_record(old, record)
    if signature_only:
        _print_verified(record, old, None, signer, part_of_record(record), json, _named(old, compared=False))
        return
    agents = trusted_agents(old, record, trust, policy)
    try:
        if benchmark is not None:
            check_networks(benchmark, record, trust)
            check_members([(old, record)], benchmark, benchmark.sha256)
        infos = {ego.name: ego.agent for ego in old.egos}
        new, _ = drive_episode(old.scenario, agents, infos=infos, benchmark=old.benchmark, act_deadline_s=deadline)
    finally:
        close_all(agents.values())
    named = _named(old, compared=benchmark is not None)
    late = _late(old, new)
    _print_verified(record, old, new.record_hash, signer, part_of_record(record), json, named, late)
    if new.record_hash != old.record_hash:
        raise typer.Exit(DIFFERS)


def _late(old: EpisodeRecord, new: EpisodeRecord) -> list[str]:
    """A sentence for each ego whose agent did not answer in time in one of two drives of an episode."""
    pairs = [(a.name, a.status, b.status) for a, b in zip(old.egos, new.egos, strict=True) if a.status != b.status]
    return [
        f"{name}: '{there}' in the record, '{here}' replayed; the deadline decides, which --deadline sets"
        for name, there, here in pairs
        if Status.AGENT_DEADLINE in (there, here)
    ]


def _check_motion(path: Path) -> None:
    """Checks that the motion beside records of parking is theirs; `path` is their file, or its folder."""
    folder = path.parent if path.is_file() else path
    read_motion_file(folder / MOTION, read_records(folder / RECORDS))


def _verify_lot(
    path: Path,
    key: str | None,
    server: str | None,
    signature_only: bool,
    policy: Path | None,
    trust: bool,
    json: bool,
    deadline: float,
) -> None:
    """Checks hash, signature and motion of a lot's record, drives the lot again and compares."""
    lot = read_lot(path)
    signer = check_signature(path, lot, key, server)
    read_lot_motion(path, lot)
    replayed = None if signature_only else drive_lots_again(path, [lot], trust, deadline, policy)[0]
    _print_verified(path, lot, replayed, signer, "", json)
    if replayed not in (None, lot.record_hash):
        raise typer.Exit(DIFFERS)


def _verify_day(
    path: Path, key: str | None, server: str | None, signature_only: bool, policy: Path | None, trust: bool, json: bool
) -> None:
    """Checks hash and signature of a day's record, judges its forecaster again and compares."""
    day = DayRecord.read(path)
    signer, replayed = check_signature(path, day, key, server), None
    if not signature_only:
        from dohyo.service.forecasting.drive import judge_again  # the freeway's simulation takes a second to import

        check_trusted(day.agent, path, trust)
        replayed = judge_again(day, policy).record_hash
    _print_verified(path, day, replayed, signer, "", json)
    if replayed not in (None, day.record_hash):
        raise typer.Exit(DIFFERS)


def _verify_morning(path: Path, key: str | None, server: str | None, signature_only: bool, json: bool) -> None:
    """Checks hash and signature of a freeway morning's record.

    Raises:
        InvalidInputError: It is to be driven again, and its planner was a policy worker.
    """
    morning = MorningRecord.read(path)
    signer = check_signature(path, morning, key, server)
    if not signature_only:
        raise InvalidInputError(
            f"'{path}': a policy worker planned this morning, so it cannot be driven again"
            " (--signature-only checks the rest)"
        )
    _print_verified(path, morning, None, signer, "", json)


def _named(record: EpisodeRecord, *, compared: bool) -> dict[str, Any]:
    """The benchmark that a record names, and whether its scenario was compared with that of the benchmark."""
    name, sha256 = record.benchmark or (None, None)
    return {"name": name, "sha256": sha256, "compared": compared}


def _print_verified(
    path: Path,
    old: Sealed,
    replayed: str | None,
    signer: Signer,
    part: str,
    json: bool,
    benchmark: Mapping[str, Any] | None = None,
    late: Sequence[str] = (),
) -> None:
    """Prints the outcome.

    Args:
        path: Path of the record.
        old: The record.
        replayed: Hash of the new drive; None if there was none.
        signer: Who signed the record.
        part: Part of the benchmark, see `part_of_record`.
        json: Whether to print JSON.
        benchmark: Of a drive, see `_named`.
        late: Of a drive, see `_late`.
    """
    same = None if replayed is None else replayed == old.record_hash
    if json:
        hashes = {"expected": old.record_hash, "replayed": replayed, "same": same}
        told = {} if benchmark is None else {"benchmark": benchmark, "late": list(late)}
        print_json({"record": str(path), **hashes, "signature": signer.document, "part": part or None} | told)
        return
    console.print(f"signature: {signer}", highlight=False)
    if benchmark is not None:
        outcome = "it has this scenario" if benchmark["compared"] else "not compared with it"
        # In quotes: a stranger's name may have lines of its own.
        named = f"{benchmark['name']!r:.80} {benchmark['sha256'][:8]!r}, {outcome}" if benchmark["name"] else "none"
        console.print(f"benchmark: {named}", highlight=False)
    if replayed is None:
        console.print(f"hash right, not driven again: {old.record_hash}", highlight=False)
    else:
        console.print(f"{'same' if same else 'DIFFERS'}: {old.record_hash} in the record, {replayed} replayed")
    for sentence in late:
        console.print(sentence, highlight=False)
    print_part(part)


def score(
    records: Annotated[list[Path], typer.Argument(help="Records, NAME.json, of one evaluation.")],
    rules: RulesOption = None,
    irs_length: IrsOption = "completed",
    json: Json = False,
) -> None:
    """Recomputes every score from the raw events."""
    for path in records:
        if is_parking_records(path):
            raise InvalidInputError(f"'{path}': records of parking, whose scores `dohyo report FOLDER` has")
    loaded = [read_whole_record(path) for path in records]
    scored = score_records((record, path) for record, path in zip(loaded, records, strict=True) if applies(record))
    rules = rules or _rules_of(loaded[0], records[0])
    summaries = _by_agent(loaded, rules, irs_length)
    drives = _drives(records, loaded, rules, irs_length)
    mixed = mixed_versions([("records", loaded)])
    if json:
        closed = {"closed_loop": closed_loop_document(scored, lost_drives(loaded))} if scored else {}
        print_json(
            scores_document(summaries, loaded)
            | {"drives": [dict(record=str(p), ego=e, **s) for p, e, s in drives]}
            | closed
            | ({"mixed_versions": mixed} if mixed else {})
        )
        return
    if drives:
        rows = [(path.stem, ego, *map(number, scores.values())) for path, ego, scores in drives]
        print_rows(["record", "ego", *SCORES], rows)
    if scored:
        print_terms(scored)
    print_comparison(summaries)
    print_meetings(loaded)
    folders = {path.absolute().parent: path for path in records}  # each is read once, not for every record
    for part in sorted({part_of_record(path) for path in folders.values()}):
        print_part(part)
    _print_mixed_versions(mixed)


def _print_mixed_versions(sentence: str) -> None:
    if sentence:
        console.print(f"take care: {sentence}", highlight=False)


def _rules_of(record: EpisodeRecord, path: Path) -> Rules:
    """Rules of the benchmark of a record; 2.0 where it has none, or an unknown one."""
    benchmark = benchmark_of_record(record, path)
    return "2.0" if benchmark is None else benchmark.rules


def _by_agent(records: Sequence[EpisodeRecord], rules: Rules, irs_length: IrsLength) -> list[Summary]:
    """Scores of each agent; the records of a mixed run have several."""
    if not any(len(agents_of([record])) > 1 for record in records):
        return [summarise(records, rules=rules, irs_length=irs_length)]
    drives = [[one for record in records if (one := drives_of(agent, record))] for agent in agents_of(records)]
    return [summarise(some, rules=rules, irs_length=irs_length) for some in drives]


def _drives(
    paths: Sequence[Path], records: Sequence[EpisodeRecord], rules: Rules, irs_length: IrsLength
) -> list[tuple[Path, str, dict[str, float]]]:
    return [
        (path, ego.name, score_drive(ego, rules=rules, irs_length=irs_length))
        for path, record in zip(paths, records, strict=True)
        if not record.lost
        for ego in record.egos
    ]
