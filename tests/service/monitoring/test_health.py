"""Readiness: whether a supervisor should send orders here."""

from __future__ import annotations

import errno
import os
import resource

import pytest

from tests.service.harness import Harness, assert_problem


def test_a_service_whose_disk_is_full_is_not_ready(service: Harness) -> None:
    """A limit of files' size refuses as a full disk does. Before, it was ready, and every order was refused."""
    assert service.client.get("/health/ready").status_code == 200
    before = sorted(service.services.settings.data.iterdir())
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, hard))
    try:
        answer = service.client.get("/health/ready")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert_problem(answer, 503, "no space is left in the data folder")
    assert service.client.get("/health/live").status_code == 200
    assert service.client.get("/health/ready").status_code == 200
    assert sorted(service.services.settings.data.iterdir()) == before


def test_a_folder_that_cannot_be_written_is_told_as_such(service: Harness, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: int) -> None:
        raise OSError(errno.EROFS, "Read-only file system")

    monkeypatch.setattr(os, "posix_fallocate", refuse)
    answer = service.client.get("/health/ready")
    assert_problem(answer, 503, "the data folder cannot be written: Read-only file system")
