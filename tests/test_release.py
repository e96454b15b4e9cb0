"""`make release`: what it refuses, the notes that it takes from the changelog, and the checksums."""

from __future__ import annotations

import importlib.util
import subprocess
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).parents[1]
CHANGELOG = """# Changelog

## [Unreleased]

## [0.2.0] - 2027-01-31

### Service

* A thing.

## [0.1.1] - soon

* Another.

## [0.1.0] - 2026-11-23
"""


@pytest.fixture
def release(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """The script, with its neighbour `install`."""
    monkeypatch.syspath_prepend(str(ROOT / ".ci"))
    spec = importlib.util.spec_from_file_location("release", ROOT / ".ci/release.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def repository(tmp_path: Path) -> Path:
    """A commit with version 0.2.0."""
    (tmp_path / "pyproject.toml").write_text('[project]\nname = "dohyo"\nversion = "0.2.0"\n')
    (tmp_path / "CITATION.cff").write_text("cff-version: 1.2.0\nversion: 0.2.0\n")
    (tmp_path / "CHANGELOG.md").write_text(CHANGELOG)
    git(tmp_path, "init", "-q")
    git(tmp_path, "add", ".")
    git(tmp_path, "-c", "user.name=A", "-c", "user.email=a@example.org", "commit", "-qm", "Begin")
    return tmp_path


def git(folder: Path, *arguments: str) -> None:
    subprocess.run(["git", "-C", str(folder), *arguments], check=True)


def tag(repository: Path, name: str) -> None:
    git(repository, "-c", "user.name=A", "-c", "user.email=a@example.org", "tag", "-am", "A release", name)


def refusal(release: ModuleType, repository: Path) -> str:
    """The line of a release that was refused, and left nothing."""
    with pytest.raises(release.RefusedError) as caught:
        release.release(repository, repository.parent / "out")
    assert not (repository.parent / "out").exists()
    return str(caught.value)


def commit(repository: Path, name: str, old: str, new: str) -> None:
    file = repository / name
    file.write_text(file.read_text().replace(old, new))
    git(repository, "-c", "user.name=A", "-c", "user.email=a@example.org", "commit", "-qam", "Change")


def test_the_notes_are_the_section_without_its_heading(release: ModuleType) -> None:
    assert release.notes_of(CHANGELOG, "0.2.0") == "### Service\n\n* A thing.\n"


@pytest.mark.parametrize(("version", "reason"), [("0.3.0", "no section"), ("0.1.1", "YYYY-MM-DD"), ("0.1.0", "empty")])
def test_a_version_without_a_dated_section_is_refused(release: ModuleType, version: str, reason: str) -> None:
    with pytest.raises(release.RefusedError, match=reason):
        release.notes_of(CHANGELOG, version)


def test_changes_that_are_not_committed_are_refused(release: ModuleType, repository: Path) -> None:
    (repository / "new.py").write_text("")
    assert "new.py" in refusal(release, repository)


def test_two_versions_are_refused(release: ModuleType, repository: Path) -> None:
    commit(repository, "CITATION.cff", "version: 0.2.0", "version: 0.1.0")
    assert "CITATION.cff" in refusal(release, repository)


def test_a_version_that_the_changelog_does_not_have_is_refused(release: ModuleType, repository: Path) -> None:
    commit(repository, "CHANGELOG.md", "## [0.2.0]", "## [0.2.1]")
    assert "CHANGELOG.md: no section [0.2.0]" in refusal(release, repository)


def test_changes_without_a_version_are_refused(release: ModuleType, repository: Path) -> None:
    commit(repository, "CHANGELOG.md", "## [Unreleased]", "## [Unreleased]\n\n### Service\n\n* Not yet.")
    assert "[Unreleased] has changes" in refusal(release, repository)


def test_a_version_of_another_commit_is_refused(release: ModuleType, repository: Path) -> None:
    tag(repository, "v0.2.0")
    release.require_untagged(repository, "0.2.0")  # of this commit: a release may be made again
    commit(repository, "CITATION.cff", "cff-version", "# None.\ncff-version")
    assert "the tag v0.2.0 is of another commit" in refusal(release, repository)


def test_a_folder_with_other_files_is_never_deleted(
    release: ModuleType, repository: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    mine = tmp_path_factory.mktemp("home") / "thesis.txt"
    mine.write_text("three years")
    for sums in ("", f"{'0' * 64}  other.txt\n"):
        with pytest.raises(release.RefusedError, match=r"holds 'thesis.txt', which is of no release"):
            release.release(repository, mine.parent)
        mine.with_name("SHA256SUMS").write_text(sums)
    assert mine.read_text() == "three years"


def test_an_earlier_release_may_be_replaced(release: ModuleType, tmp_path: Path) -> None:
    (tmp_path / "dohyo.whl").write_text("a wheel")
    release.write_sums(tmp_path)
    release.require_replaceable(tmp_path)
    release.require_replaceable(tmp_path / "absent")


def test_this_version_has_notes(release: ModuleType) -> None:
    """Those of a development version are not released, and keep it from being so."""
    changelog, version = (ROOT / "CHANGELOG.md").read_text(), release.version_of(ROOT)
    if ".dev" in version:
        with pytest.raises(release.RefusedError, match=r"\[Unreleased\] has changes"):
            release.require_all_released(changelog)
    else:
        assert "### " in release.notes_of(changelog, version)


def test_the_sums_are_those_that_sha256sum_checks(release: ModuleType, tmp_path: Path) -> None:
    (tmp_path / "dohyo.whl").write_bytes(b"wheel")
    (tmp_path / "NOTES.md").write_text("notes")
    release.write_sums(tmp_path)
    check = ["sha256sum", "--check", "--strict", "SHA256SUMS"]
    done = subprocess.run(check, cwd=tmp_path, capture_output=True, text=True, check=True)
    assert done.stdout == "NOTES.md: OK\ndohyo.whl: OK\n"
    (tmp_path / "NOTES.md").write_text("others")
    assert subprocess.run(check, cwd=tmp_path, capture_output=True, check=False).returncode == 1
