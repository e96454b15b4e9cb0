"""Makes a release of the commit that is checked out: `make release`, or `.venv/bin/python .ci/release.py [FOLDER]`.

FOLDER, `dist/VERSION` without it, then holds the wheel, the sdist, NOTES.md (the version's section of CHANGELOG.md) and
SHA256SUMS. Both archives are made from the commit, the wheel from the sdist, so that neither can have what is not in
the repository. Nothing is uploaded or tagged. Refusals are one line and exit code 2.
"""

from __future__ import annotations

import hashlib
import io
import os
import re
import shutil
import subprocess
import sys
import tarfile
import tempfile
import tomllib
import venv
import zipfile
from pathlib import Path

import install

ROOT = Path(__file__).parents[1]
BUILD = "import setuptools.build_meta as backend, sys; getattr(backend, sys.argv[1])(sys.argv[2])"
SECTION = re.compile(r"^## \[(?P<version>[^\]]+)\](?P<rest>.*)$", re.MULTILINE)
DATE = re.compile(r" - \d{4}-\d{2}-\d{2}")
UNRELEASED = "Unreleased"
FLOORS = ("sumo_networks", "evaluation", "agents", "service")
ONLY_IN_THE_REPOSITORY = re.compile(r"\.md$|/results/")


class RefusedError(Exception):
    """There is nothing to release."""


def version_of(root: Path) -> str:
    """The version in pyproject.toml.

    Raises:
        RefusedError: CITATION.cff has another one.
    """
    with (root / "pyproject.toml").open("rb") as file:
        version = str(tomllib.load(file)["project"]["version"])
    cited = re.search(r"^version: (.+)$", (root / "CITATION.cff").read_text(encoding="utf-8"), re.MULTILINE)
    if cited is None or cited[1] != version:
        raise RefusedError(f"CITATION.cff: expected version {version}, as in pyproject.toml")
    return version


def notes_of(changelog: str, version: str) -> str:
    """A version's section of a changelog, without its heading.

    Raises:
        RefusedError: No such section, no date in its heading, or no line below it.
    """
    if version not in (sections := _sections(changelog)):
        raise RefusedError(f"CHANGELOG.md: no section [{version}]")
    heading, notes = sections[version]
    if not DATE.fullmatch(heading["rest"]):
        raise RefusedError(f"CHANGELOG.md: expected '## [{version}] - YYYY-MM-DD', got '{heading[0]}'")
    if not notes:
        raise RefusedError(f"CHANGELOG.md: the section [{version}] is empty")
    return f"{notes}\n"


def require_all_released(changelog: str) -> None:
    """Checks that no change waits for a version.

    Raises:
        RefusedError: The section [Unreleased] is not empty.
    """
    sections = _sections(changelog)
    if UNRELEASED in sections and sections[UNRELEASED][1]:
        raise RefusedError(f"CHANGELOG.md: [{UNRELEASED}] has changes: give them a version and a date")


def require_untagged(root: Path, version: str) -> None:
    """Checks that a version is of no other commit.

    Raises:
        RefusedError: Its tag exists on another commit.
    """
    commits = ["git", "-C", str(root), "rev-parse", "--verify", "--quiet"]
    tagged = subprocess.run(
        [*commits, f"refs/tags/v{version}^{{commit}}"], capture_output=True, text=True, check=False
    ).stdout.strip()
    if tagged and tagged != _output(*commits, "HEAD").strip():
        raise RefusedError(f"the tag v{version} is of another commit, {tagged[:12]}: choose a new version")


def require_clean(root: Path) -> None:
    """Checks that the commit is all there is.

    Raises:
        RefusedError: Files were changed or added and are not committed.
    """
    changed = _output("git", "-C", str(root), "status", "--porcelain").splitlines()
    if changed:
        raise RefusedError(f"commit first: {len(changed)} changes, such as '{changed[0]}'")


def require_replaceable(out: Path) -> None:
    """Checks that a folder is absent, empty or an earlier release, since it is deleted.

    Raises:
        RefusedError: It has a file that its SHA256SUMS does not name.
    """
    sums = out / "SHA256SUMS"
    released = (
        {line.split("  ", 1)[-1] for line in sums.read_text(encoding="utf-8").splitlines()} if sums.exists() else set()
    )
    for path in out.iterdir() if out.exists() else ():
        if path.name not in {*released, "SHA256SUMS"}:
            raise RefusedError(f"'{out}' holds '{path.name}', which is of no release: choose another folder")


def build(root: Path, out: Path) -> Path:
    """Builds the sdist from the commit and the wheel from the sdist, with the commit's time; returns the wheel.

    Raises:
        RefusedError: The wheel misses a file of the commit.
    """
    environment = {
        **os.environ,
        "SOURCE_DATE_EPOCH": _output("git", "-C", str(root), "log", "-1", "--format=%ct").strip(),
    }
    with tempfile.TemporaryDirectory() as folder:
        commit, unpacked = Path(folder) / "commit", Path(folder) / "sdist"
        archive = subprocess.run(["git", "-C", str(root), "archive", "HEAD"], check=True, capture_output=True).stdout
        with tarfile.open(fileobj=io.BytesIO(archive)) as tar:
            tar.extractall(commit, filter="tar")
        _backend("build_sdist", out, commit, environment)
        (sdist,) = out.glob("*.tar.gz")
        with tarfile.open(sdist) as tar:
            tar.extractall(unpacked, filter="tar")
        _backend("build_wheel", out, next(unpacked.iterdir()), environment)
        (wheel,) = out.glob("*.whl")
        files = [path.relative_to(commit) for floor in FLOORS for path in (commit / floor).rglob("*") if path.is_file()]
    names = set(zipfile.ZipFile(wheel).namelist())
    missing = [path for path in files if not (f"dohyo/{path}" in names or ONLY_IN_THE_REPOSITORY.search(str(path)))]
    if missing:
        raise RefusedError(f"{wheel.name} misses {len(missing)} files, such as {missing[0]}")
    return wheel


def check_installs(wheel: Path, version: str) -> None:
    """Installs the wheel with all it requires into a new environment, and asks `dohyo` for its version.

    Raises:
        RefusedError: It says another one.
    """
    with tempfile.TemporaryDirectory() as folder:
        venv.create(folder, with_pip=True)
        python, (variables, torch) = f"{folder}/bin/python", install.plan(os.environ)
        print(f"dohyo: installing {wheel.name} into a new environment; {torch}", flush=True)
        subprocess.run([python, *install.COMMAND, str(wheel)], check=True, env=variables, cwd=folder)
        said = subprocess.run(
            [f"{folder}/bin/dohyo", "--version"], check=True, capture_output=True, text=True, cwd=folder
        )
    if said.stdout.strip() != f"dohyo {version}":
        raise RefusedError(f"the installed command says '{said.stdout.strip()}', expected 'dohyo {version}'")


def write_sums(folder: Path) -> None:
    """Writes SHA256SUMS of all files in a folder, for `sha256sum -c SHA256SUMS`."""
    files = sorted(path for path in folder.iterdir() if path.name != "SHA256SUMS")
    lines = [f"{hashlib.sha256(path.read_bytes()).hexdigest()}  {path.name}\n" for path in files]
    (folder / "SHA256SUMS").write_text("".join(lines), encoding="utf-8")


def release(root: Path, out: Path | None) -> None:
    """Makes the release, or nothing at all.

    Raises:
        RefusedError: See the functions above.
    """
    require_clean(root)
    version = version_of(root)
    changelog = (root / "CHANGELOG.md").read_text(encoding="utf-8")
    require_all_released(changelog)
    require_untagged(root, version)
    notes = notes_of(changelog, version)
    out = out or root / "dist" / version
    require_replaceable(out)
    with tempfile.TemporaryDirectory() as folder:
        made = Path(folder) / version
        made.mkdir()
        wheel = build(root, made)
        check_installs(wheel, version)
        (made / "NOTES.md").write_text(notes, encoding="utf-8")
        write_sums(made)
        shutil.rmtree(out, ignore_errors=True)
        shutil.copytree(made, out)
    print((out / "SHA256SUMS").read_text(encoding="utf-8"), end="")
    tag = f"git tag -a v{version} --cleanup=verbatim -F {out / 'NOTES.md'}"
    print(f"dohyo: {out} has the release; its commit gets the tag by: {tag}")


def _sections(changelog: str) -> dict[str, tuple[re.Match[str], str]]:
    """Heading and text of each version's section."""
    headings = list(SECTION.finditer(changelog))
    ends = [*(following.start() for following in headings[1:]), len(changelog)]
    return {
        heading["version"]: (heading, changelog[heading.end() : end].strip())
        for heading, end in zip(headings, ends, strict=True)
    }


def _backend(hook: str, out: Path, source: Path, environment: dict[str, str]) -> None:
    done = subprocess.run(
        [sys.executable, "-c", BUILD, hook, str(out)],
        cwd=source,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        print(done.stderr, file=sys.stderr)
        raise RefusedError(f"{hook} failed, see above")


def _output(*command: str) -> str:
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout


if __name__ == "__main__":
    try:
        release(ROOT, Path(sys.argv[1]).resolve() if len(sys.argv) > 1 else None)
    except RefusedError as error:
        print(f"dohyo: no release: {error}", file=sys.stderr)
        sys.exit(2)
