from __future__ import annotations

import errno
import json
import os
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from dohyo.agents.registry import agent_entries
from dohyo.evaluation.agent import agent_info, make_agent
from dohyo.service.policies.agent import OnnxPolicy
from dohyo.service.submissions import installed
from tests.agents.packages import install_lab
from tests.service.harness import Caller, Harness, assert_problem
from tests.service.policies.models import identity

SPEC = {"track": "map", "sensors": ["speedometer"], "control": "target_speed_steering"}


@pytest.fixture
def team(service: Harness) -> Caller:
    caller = service.caller("team")
    assert caller.post("/v1/agents", {"name": "mine", "description": "Ours."}).status_code == 201
    return caller


def policy() -> bytes:
    content: bytes = identity().SerializeToString()
    return content


def submit(team: Caller, order: object, **options: Any) -> Any:
    return team.post("/v1/agents/mine/submissions", order, **options)


def upload(team: Caller, content: bytes, spec: object = SPEC, name: str = "policy.onnx", **options: Any) -> Any:
    form = {"spec": spec if isinstance(spec, str) else json.dumps(spec)}
    return team.post("/v1/agents/mine/submissions/onnx", data=form, files={"file": (name, content)}, **options)


def test_names_are_taken_once_for_all_owners(stored: Harness) -> None:
    blue, red = stored.caller("blue"), stored.caller("red")
    assert blue.post("/v1/agents", {"name": "fast"}).status_code == 201
    for same in ("fast", "Fast"):
        assert_problem(red.post("/v1/agents", {"name": same}), 409, "agent 'fast' exists")
    assert_problem(blue.post("/v1/agents", {"name": "fast"}), 409)
    key = {"idempotency-key": "once"}
    for _ in range(2):
        assert blue.post("/v1/agents", {"name": "faster"}, headers=key).status_code == 201


@pytest.mark.parametrize(
    "name", ["", "..", "../x", "a/b", ".hidden", "a b", "a\x00", "é", "<script>", "a" * 101, "-a", None, 7]
)
def test_impossible_names(service: Harness, name: object) -> None:
    assert_problem(service.caller("team").post("/v1/agents", {"name": name}), 422)


def test_paths_in_addresses_lead_nowhere(service: Harness) -> None:
    for name in ("..%2f..%2fetc%2fpasswd", "%2e%2e", "a%00b", "x" * 101, "%ff%fe", "quickstart.toml"):
        for path in (
            f"/v1/agents/{name}",
            f"/v1/networks/{name}",
            f"/v1/networks/{name}/map",
            f"/v1/benchmarks/{name}",
        ):
            assert service.client.get(path).status_code in (404, 422), path


def test_a_built_in_agent_is_what_a_local_evaluation_would_record(service: Harness, team: Caller) -> None:
    made = submit(team, {"kind": "builtin", "entry": "random", "settings": {}})
    assert made.status_code == 201, made.text
    entry = agent_entries()["random"]
    info = agent_info(make_agent(entry), entry, None, "builtin").model_dump(mode="json")
    with service.services.database.reading() as session:
        from dohyo.service.submissions.model import Submission

        assert session.get_one(Submission, made.json()["id"]).info == info
    assert made.json()["version"] == 1
    assert submit(team, {"kind": "remote"}).json()["version"] == 2
    assert [one["version"] for one in team.get("/v1/agents/mine/submissions").json()["items"]] == [2, 1]
    assert team.get("/v1/agents/mine").json()["kind"] == "remote"


@pytest.mark.slow
@pytest.mark.parametrize("entry", sorted(agent_entries()))
def test_every_built_in_agent_can_be_submitted(team: Caller, entry: str) -> None:
    made = submit(team, {"kind": "builtin", "entry": entry})
    assert made.status_code == 201, made.text


@pytest.mark.parametrize(
    ("order", "says"),
    [
        ({"kind": "builtin", "entry": "autopilott"}, "did you mean 'autopilot'"),
        ({"kind": "builtin", "entry": "os:system", "settings": {"command": "touch HERE"}}, "no built-in agent"),
        ({"kind": "builtin", "entry": "dohyo.service.policies.agent:OnnxPolicy"}, "no built-in agent"),
        ({"kind": "builtin", "entry": "autopilot", "settings": {"nonsense": 1}}, "its settings are acceleration, "),
        ({"kind": "builtin", "entry": "autopilot", "settings": {"max_speed": -3}}, "above 0, at most 60, got -3"),
        ({"kind": "builtin", "entry": "rules", "settings": {"rules": "/etc"}}, "'rules': unknown"),
        ({"kind": "builtin", "entry": "mbappe", "settings": {"simulations": 10**8}}, "at most 100000, got 100000000"),
        ({"kind": "remote", "track": "sensors", "sensors": ["route"]}, "'route'"),
        ({"kind": "remote", "track": "map", "sensors": ["speedometer", "objects"]}, "'objects'"),
        ({"kind": "remote", "sensors": ["sonar"]}, "sonar"),
        ({"kind": "remote", "control": "telepathy"}, "telepathy"),
        ({"kind": "remote", "sensors": []}, "at least 1"),
        ({"kind": "remote", "source_sha256": "xyz"}, "source_sha256"),
        ({"kind": "remote", "settings": {"deep": "x" * 30_000}}, "characters"),
        ({"kind": "onnx", "entry": "x"}, "builtin"),
        ({"kind": "remote", "extra": 1}, "extra"),
        ({}, "kind"),
    ],
)
def test_what_cannot_drive_is_refused_and_leaves_nothing(
    team: Caller, tmp_path: Path, order: dict[str, Any], says: str
) -> None:
    answer = submit(team, order)
    assert_problem(answer, 422, says)
    assert str(tmp_path) not in answer.text
    assert team.get("/v1/agents/mine/submissions").json()["items"] == []


def test_settings_are_checked_by_their_schema_before_anything_is_built(
    team: Caller, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(installed, "run", lambda *_, **__: pytest.fail("an agent was built"))
    answer = submit(team, {"kind": "builtin", "entry": "autopilot", "settings": {"max_speed": "fast", "gap": 51}})
    assert_problem(answer, 422)
    assert [one["where"] for one in answer.json()["errors"]] == ["body.settings.max_speed", "body.settings.gap"]


@pytest.mark.parametrize(
    ("order", "where"),
    [
        ({"kind": "builtin"}, "body.entry"),
        ({"kind": "builtin", "entry": 3}, "body.entry"),
        ({"kind": "builtin", "entry": "idm", "color": "red"}, "body.color"),
        ({"kind": "builtin", "entry": "idm", "builtin": {}}, "body.builtin"),
        ({"kind": "remote", "sensors": ["route", 1]}, "body.sensors.1"),
        ({"kind": "nobody"}, "body"),
    ],
)
def test_the_place_of_a_fault_is_one_that_the_body_has_or_lacks(
    team: Caller, order: dict[str, object], where: str
) -> None:
    answer = team.post("/v1/agents/a/submissions", order)
    assert_problem(answer, 422, f"{where}: ")
    assert [one["where"] for one in answer.json()["errors"]] == [where]


def test_built_in_agents_are_listed_with_their_settings(team: Caller) -> None:
    listed = {one["name"]: one for one in team.get("/v1/builtin-agents").json()}
    assert listed.keys() == agent_entries().keys()
    assert listed["reckless"]["settings"]["properties"]["throttle"] == {
        "type": "number", "default": 0.5, "minimum": 0, "maximum": 1
    }  # fmt: skip
    assert "rules" not in listed["rules"]["settings"]["properties"], "a stranger names no folder of the server"
    assert team.get("/v1/builtin-agents/reckless").json() == listed["reckless"]
    assert_problem(team.get("/v1/builtin-agents/recless"), 404, "did you mean 'reckless'")


def test_an_agent_that_cannot_be_described_hides_no_other(
    team: Caller, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    dohyos = agent_entries().keys()
    install_lab(tmp_path, monkeypatch)
    assert {one["name"] for one in team.get("/v1/builtin-agents").json()} == dohyos | {"lab-open"}
    assert [one.partition(": ")[2].partition(":")[0] for one in caplog.messages if "left out" in one] == [
        "agent 'lab-closed' of package 'old-lab'", "agent 'lab-gone' of package 'old-lab'"
    ]  # fmt: skip
    assert team.get("/v1/builtin-agents/autopilot").status_code == 200
    assert_problem(team.get("/v1/builtin-agents/lab-closed"), 404, "'lab-closed' of package 'old-lab'")


def test_a_strangers_module_is_never_imported(team: Caller, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "trap.py").write_text(f"open({str(tmp_path / 'sprung')!r}, 'w')\nclass Trap: pass\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    assert_problem(submit(team, {"kind": "builtin", "entry": "trap:Trap"}), 422)
    # A remote agent may call itself anything; the name is only written down.
    assert submit(team, {"kind": "remote", "entry": "trap:Trap"}).status_code == 201
    assert not (tmp_path / "sprung").exists()


@pytest.mark.parametrize("text", ['{"kind":"remote","settings":{"x":NaN}}', '{"kind":"remote","settings":{"x":1e999}}'])
def test_numbers_that_are_none(team: Caller, text: str) -> None:
    headers = {"content-type": "application/json"}
    assert_problem(submit(team, None, content=text, headers=headers), 422)


def test_a_settings_tree_of_a_thousand_floors(team: Caller) -> None:
    text = '{"kind":"remote","settings":' + '{"a":' * 1500 + "1" + "}" * 1500 + "}"
    answer = submit(team, None, content=text, headers={"content-type": "application/json"})
    assert answer.status_code in (201, 400, 422)  # as deep as Python's parser goes


def test_a_trial_that_never_ends_is_ended(team: Caller, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(installed, "TRIAL", replace(installed.TRIAL, wall_s=0.001))
    assert_problem(submit(team, {"kind": "builtin", "entry": "autopilot"}), 422, "longer than 0.001 s")


def test_the_same_key_makes_one_submission(team: Caller) -> None:
    key = {"idempotency-key": "k"}
    first, again = (submit(team, {"kind": "remote"}, headers=key).json() for _ in range(2))
    assert first == again
    assert len(team.get("/v1/agents/mine/submissions").json()["items"]) == 1
    assert_problem(submit(team, {"kind": "remote", "name": "x"}, headers=key), 422, "another request")


def test_an_onnx_policy_is_stored_by_its_hash_and_can_be_made_again(
    service: Harness, team: Caller, monkeypatch: pytest.MonkeyPatch
) -> None:
    content = policy()
    made = upload(team, content, name="../../../etc/cron.d/evil.onnx")
    assert made.status_code == 201, made.text
    body, folder = made.json(), service.services.settings.policies
    assert (body["kind"], body["track"], body["name"]) == ("onnx", "map", "mine")
    assert [path.name for path in folder.iterdir()] == [f"{body['policy_sha256']}.onnx"]
    assert (folder / f"{body['policy_sha256']}.onnx").read_bytes() == content
    again = OnnxPolicy(**body["settings"])
    assert again.sha256 == body["policy_sha256"]


@pytest.mark.parametrize(
    ("content", "spec", "says"),
    [
        (b"", SPEC, "empty"),
        (b"\x80\x04\x95pickle", SPEC, "pickle"),
        (b"PK\x03\x04" + bytes(100), SPEC, "ZIP"),
        (b"import os", SPEC, "text"),
        (None, {**SPEC, "sensors": ["objects"]}, "objects"),
        (None, {**SPEC, "sensors": ["sonar"]}, "sonar"),
        (None, {**SPEC, "sensors": ["speedometer", "route"]}, "route"),
        (None, {**SPEC, "track": "omniscient"}, "track"),
        (None, {**SPEC, "code": "x"}, "code"),
        (None, "no json", "JSON"),
        (None, "[]", "JSON"),
        (None, "[" * 100_000, "JSON"),
    ],
)
def test_what_is_no_policy_is_refused_and_leaves_nothing(
    service: Harness, team: Caller, content: bytes | None, spec: object, says: str
) -> None:
    assert_problem(upload(team, policy() if content is None else content, spec), 422, says)
    assert list(service.services.settings.policies.iterdir()) == []
    assert team.get("/v1/agents/mine/submissions").json()["items"] == []


def test_forms_that_are_none(team: Caller) -> None:
    path, headers = "/v1/agents/mine/submissions/onnx", team.headers
    post = team.client.post
    assert_problem(post(path, json={"a": 1}, headers=headers), 422, "multipart")
    assert_problem(post(path, data={"spec": "{}"}, files={"other": b"x"}, headers=headers), 422, "'file'")
    torn = headers | {"content-type": "multipart/form-data; boundary=x"}
    assert_problem(post(path, content=b'--x\r\nContent-Disposition: form-data; name="file"', headers=torn), 422)
    assert_problem(post(path, content=b"--x--", headers=headers | {"content-type": "multipart/form-data"}), 422)


def test_a_full_disk_keeps_nothing_of_a_policy(service: Harness, team: Caller, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(descriptor: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr("dohyo.sumo_networks.files.os.fsync", full)
    assert_problem(upload(team, policy()), 507, "no space")
    assert list(service.services.settings.policies.iterdir()) == []
    assert team.get("/v1/agents/mine/submissions").json()["items"] == []
    monkeypatch.undo()
    assert upload(team, policy()).status_code == 201


def test_the_published_observations_are_what_a_submission_must_fit(service: Harness) -> None:
    get = service.client.get
    whole = get("/v1/observations").json()
    assert {"speedometer", "route", "objects"} <= set(whole["sensors"])
    some = get("/v1/observations?track=map&sensors=speedometer,route").json()
    assert [one["name"] for one in some["inputs"]] == ["speedometer", "route"]
    assert_problem(get("/v1/observations?track=sensors&sensors=route"), 422, "'route'")
    assert_problem(get("/v1/observations?sensors=sonar"), 404, "sonar")
    assert_problem(get("/v1/observations?control=telepathy"), 404, "telepathy")
