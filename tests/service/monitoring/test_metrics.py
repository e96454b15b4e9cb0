"""Metrics for Prometheus: who may read them, and what they count; read by Prometheus' own parser."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import pytest
from prometheus_client.parser import text_string_to_metric_families
from pydantic import SecretStr

from dohyo.service.accounts.model import Role
from dohyo.service.monitoring.metrics import STEP
from tests.service.harness import PASSWORD_OF_NOBODY, Caller, Harness, assert_problem, running


def scraped(service: Harness) -> dict[tuple[str, frozenset[tuple[str, str]]], float]:
    """Values by name and labels, as an administrator reads them."""
    answer = service.caller("root", Role.ADMIN).get("/metrics")
    assert answer.headers["content-type"].startswith("text/plain")
    families = list(text_string_to_metric_families(answer.text))
    assert all(family.documentation for family in families)
    assert len({family.name for family in families}) == len(families)
    return {(one.name, frozenset(one.labels.items())): one.value for family in families for one in family.samples}


def labels(**given: Any) -> frozenset[tuple[str, str]]:
    return frozenset(given.items())


def test_only_administrators_and_the_token_of_the_settings_may_read_them(tmp_path: Path) -> None:
    with running(tmp_path / "data", metrics_token=SecretStr("for-prometheus")) as service:
        assert_problem(service.client.get("/metrics"), 401)
        assert_problem(service.caller("team").get("/metrics"), 403, "admin")
        scraper = Caller(service.client, "for-prometheus")
        assert scraper.get("/metrics").status_code == 200
        assert_problem(scraper.get("/v1/me"), 401)
    with running(tmp_path / "data") as service:
        assert_problem(Caller(service.client, "for-prometheus").get("/metrics"), 401)


@pytest.mark.parametrize("empty", ["", "  "])
def test_an_empty_token_of_the_settings_lets_nobody_in(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, empty: str
) -> None:
    monkeypatch.setenv("DOHYO_METRICS_TOKEN", empty)
    with running(tmp_path / "data") as service:
        assert service.services.settings.metrics_token is None
        assert_problem(service.client.get("/metrics"), 401)
        assert_problem(service.client.get("/metrics", headers={"authorization": f"Bearer {empty}"}), 401)
        assert service.caller("root", Role.ADMIN).get("/metrics").status_code == 200


def test_requests_are_counted_by_route_and_not_by_what_a_client_invents(service: Harness) -> None:
    team = service.caller("team")
    for name in "abc":
        team.agent(name)
        assert team.get(f"/v1/agents/{name}").status_code == 200
        assert team.get(f"/invented/{name}").status_code == 404
    assert service.client.request("BREW", "/v1/agents").status_code == 405
    found = scraped(service)
    assert found["dohyo_requests_total", labels(route="/v1/agents/{name}", method="GET", status="200")] == 3
    assert found["dohyo_request_seconds_count", labels(route="/v1/agents/{name}")] == 3
    invented = [key for key in found if "invented" in str(key) or "BREW" in str(key)]
    assert invented == []


def test_what_is_refused_is_counted_by_its_reason(tmp_path: Path) -> None:
    with running(tmp_path / "data", body_limit_bytes=2000) as service:
        assert Caller(service.client, PASSWORD_OF_NOBODY).get("/v1/me").status_code == 401
        assert service.caller("team").post("/v1/agents", {"name": "x" * 3000}).status_code == 413
        found = scraped(service)
    assert found["dohyo_refused_total", labels(reason="wrong token")] == 1
    assert found["dohyo_refused_total", labels(reason="body too large")] == 1


def test_the_state_of_the_service_is_told(service: Harness) -> None:
    team = service.caller("team")
    team.agent("a")
    evaluation = team.evaluation("a")
    service.services.events.publish(f"evaluation:{evaluation}", {"episode": "ep-1", "status": "done"})
    found = scraped(service)
    assert found["dohyo_evaluations", labels(status="queued")] == 1
    assert found["dohyo_episodes", labels(status="queued")] > 1
    assert found["dohyo_episode_changes_total", labels(status="done")] == 1
    assert found["dohyo_scheduler_running", labels()] == 0
    assert 0 < found["dohyo_data_free_bytes", labels()] <= shutil.disk_usage(service.services.settings.data).total
    assert found["dohyo_start_time_seconds", labels()] == service.services.started.timestamp()
    (build,) = [dict(key[1]) for key in found if key[0] == "dohyo_build_info"]
    assert build["sumo"] == "1.28.0"


def test_steps_of_workers_are_counted_by_themselves(service: Harness) -> None:
    service.services.metrics.note_request(
        {"type": "http", "path": "/v1/leases/l-1/step", "method": "POST"}, 200, 0.0004
    )
    found = scraped(service)
    assert found["dohyo_wire_step_seconds_count", labels()] == 1
    assert found["dohyo_wire_step_seconds_bucket", labels(le="0.0003")] == 0
    assert not [key for key in found if STEP in str(key)]


def test_steps_of_live_worlds_are_requests_as_others(service: Harness) -> None:
    """They wait for the other drivers of the world, up to half a minute."""
    scope = {
        "type": "http",
        "path": "/v1/seats/s-1/step",
        "method": "POST",
        "state": {"route": "/v1/seats/{seat}/step"},
    }
    service.services.metrics.note_request(scope, 200, 25.0)
    found = scraped(service)
    assert found["dohyo_wire_step_seconds_count", labels()] == 0
    assert found["dohyo_requests_total", labels(route="/v1/seats/{seat}/step", method="POST", status="200")] == 1
