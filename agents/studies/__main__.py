"""Studies of all systems. The same command resumes.

    python -m dohyo.agents.studies                                    # names
    python -m dohyo.agents.studies ghrl run --set runs=runs/study --workers 2
    python -m dohyo.agents.studies ghrl run --arms ghrl-r --trainings 0 --only precrash
    python -m dohyo.agents.studies ghrl table                         # published rows; or --rows out/studies/ghrl
    python -m dohyo.agents.studies all table --write                  # every section of every RESULTS.md
    python -m dohyo.agents.studies ghrl-trainings figures

`run` writes a row per cell to OUT/rows.jsonl, by default into out/studies/NAME.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from dohyo.agents.learning.files.settings import read_settings
from dohyo.agents.studies.arms import Cell
from dohyo.agents.studies.registry import studies, study_named
from dohyo.agents.studies.runner import Job
from dohyo.agents.studies.study import Results, Study, read_results
from dohyo.agents.studies.tables import write_section
from dohyo.sumo_networks.errors import DohyoError, InvalidInputError, UnknownNameError

INTERRUPTED = 130
NOT_INSTALLED = "; they are in dohyo's repository only, not in an installed dohyo; --rows FOLDER reads those of a run"


def main(arguments: Sequence[str] | None = None) -> None:
    """Command-line entry point.

    Raises:
        DohyoError: The study cannot be run, its rows are missing, or an option of a run is given for something else.
    """
    parser = argparse.ArgumentParser(
        prog="python -m dohyo.agents.studies", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("name", nargs="?", metavar="NAME", help=f"all, {', '.join(studies())}")
    parser.add_argument("action", nargs="?", choices=("run", "table", "figures"), default="table")
    parser.add_argument("--set", nargs="+", dest="settings", default=[], metavar="KEY=VALUE", help="options of a run")
    parser.add_argument("--arms", nargs="+", metavar="ARM", help="of a run; default: all")
    parser.add_argument("--trainings", nargs="+", type=int, metavar="SEED", help="of a run; default: all")
    parser.add_argument("--only", nargs="+", metavar="PREFIX", help="of a run: benchmarks or scenarios; default: all")
    parser.add_argument("--workers", type=int, default=1, help="processes of a run")
    parser.add_argument("--out", type=Path, help="folder of the rows of a run, or of figures")
    parser.add_argument("--rows", type=Path, help="folder of the rows of a table; default: the published rows")
    parser.add_argument("--section", help="of a table; default: all")
    parser.add_argument("--write", action="store_true", help="write the tables into RESULTS.md")
    given = parser.parse_args(arguments)
    if given.name is None:
        print("\n".join(f"{name:16} {study_named(name).summary}" for name in studies()))
        return
    for option in ("arms", "trainings", "only"):
        if given.action != "run" and getattr(given, option) is not None:
            raise InvalidInputError(
                f"--{option}: expected with 'run', got '{given.action}': claims are corrected together, over all rows"
            )
    for name in studies() if given.name == "all" else (given.name,):
        study = study_named(name)
        if given.action == "run":
            _run(name, study, given)
        elif not (results := _stored(study, given)).rows:
            print(f"{name}: no stored rows{_why(study.stored, given)}")
        elif given.action == "table":
            _table(name, study, results, given)
        elif study.figures is not None:
            for path in study.figures(results, given.out or Path("out/studies") / name):
                print(f"figure: {path}")


def _run(name: str, study: Study[Any], given: argparse.Namespace) -> None:
    cells = study.cells(read_settings(study.options, None, given.settings))
    for what, wanted, there in (
        ("arm", given.arms, {cell.arm for cell in cells}),
        ("training", given.trainings, {str(cell.training_seed) for cell in cells} - {str(None)}),
    ):
        if unknown := [str(one) for one in wanted or () if str(one) not in there]:
            raise UnknownNameError(f"{what} of '{name}'", unknown[0], there)

    def chosen(cell: Cell) -> bool:
        return (
            (given.arms is None or cell.arm in given.arms)
            and (given.trainings is None or cell.training_seed in (None, *given.trainings))
            and (given.only is None or any(f"{cell.benchmark}/{cell.scenario}".startswith(one) for one in given.only))
        )

    out = given.out or Path("out/studies") / name
    began, fresh = time.monotonic(), 0

    def progress(done: int, total: int, job: Job) -> None:
        nonlocal fresh
        fresh += len(job)  # rows of earlier calls took no time of this one
        left = f", {(total - done) * (time.monotonic() - began) / fresh / 60:.0f} min left"
        cell = job[0]
        seed = "" if cell.training_seed is None else f" of training {cell.training_seed}"
        print(f"{done} of {total}{left}: {cell.arm}{seed}, {cell.benchmark}, {cell.scenario}", flush=True)

    try:
        study.run(out, given.settings, chosen=chosen, workers=given.workers, progress=progress)
    except KeyboardInterrupt:
        print("stopped; the same command goes on", file=sys.stderr)
        sys.exit(INTERRUPTED)
    results = read_results(out)
    lost = sum("lost" in row for row in results.rows)
    print(f"rows: {out}" + (f"; {lost} cells were lost, the same command runs them again" if lost else ""))


def _table(name: str, study: Study[Any], results: Results, given: argparse.Namespace) -> None:
    for section, table in sections(name, study).items():
        text = table(results) if given.section in (None, section) else ""
        if text and given.write:
            write_section(study.page, section, text)
            print(f"{study.page}: {section}")
        elif text:
            print(f"{text}\n")


def sections(name: str, study: Study[Any]) -> dict[str, Callable[[Results], str]]:
    """Sections of a study's page: with which versions its rows were made, and its tables."""
    return {
        f"rows of {name}": lambda found: f"Rows of `{name}` were made with dohyo {' and '.join(found.versions)}.",
        **study.tables,
    }


def _stored(study: Study[Any], given: argparse.Namespace) -> Results:
    folder = given.rows or study.stored
    results = study.read(folder) if folder.exists() else Results((), {})
    if not results.rows and given.name != "all":
        raise InvalidInputError(f"'{folder}': expected stored rows, found none{_why(folder, given)}")
    return results


def _why(folder: Path, given: argparse.Namespace) -> str:
    """Why there are no published rows; "" where others were asked for, or where there is a folder of them."""
    return NOT_INSTALLED if given.rows is None and not folder.exists() else ""


if __name__ == "__main__":
    try:
        main()
    except DohyoError as error:
        sys.exit(f"studies: {error}")
