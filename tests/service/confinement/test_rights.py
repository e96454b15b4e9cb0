"""Rights: what a confined process gives up is really gone, on this machine."""

from __future__ import annotations

from pathlib import Path

import pytest

from dohyo.service.confinement.probe import probe
from dohyo.service.confinement.tasks import Rights


@pytest.mark.parametrize("rights", Rights)
def test_every_attempt_to_do_more_is_refused(rights: Rights, tmp_path: Path) -> None:
    secret = tmp_path / "secret"
    secret.write_text("of another tenant")
    attempts = probe(rights, secret)["attempts"]
    assert len(attempts) >= 14
    assert {name: result for name, result in attempts.items() if not result.startswith("refused")} == {}
    assert secret.read_text() == "of another tenant"
