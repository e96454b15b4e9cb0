"""Signing in, errors as pages, and what is served to whom, without a browser."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest

from dohyo.evaluation.records.specifications import InfractionKind
from dohyo.service import dashboard
from tests.service.dashboard import fake as fakes
from tests.service.dashboard.conftest import Site, Visitor

HTML = {"accept": "text/html"}


@pytest.fixture
def client(site: Site) -> Iterator[httpx.Client]:
    with httpx.Client(base_url=site.origin, trust_env=False, timeout=120) as one:
        yield one


def sign_in(client: httpx.Client, token: str = fakes.TOKEN, headers: dict[str, str] | None = None) -> httpx.Response:
    return client.post("/login", data={"token": token, "next": "/evaluations"}, headers=headers)


def test_a_token_becomes_a_cookie_that_scripts_and_other_sites_cannot_use(client: httpx.Client) -> None:
    answer = sign_in(client)
    assert (answer.status_code, answer.headers["location"]) == (303, "/evaluations")
    cookie = answer.headers["set-cookie"].lower()
    assert "httponly" in cookie
    assert "samesite=strict" in cookie
    assert "expires" not in cookie
    assert client.get("/v1/me").json()["owner"] == "lab"


def test_the_cookie_reads_and_an_authorization_comes_first(client: httpx.Client) -> None:
    sign_in(client)
    assert client.get("/v1/echo").json() == f"Bearer {fakes.TOKEN}"
    assert client.get("/v1/echo", headers={"authorization": "Bearer another"}).json() == "Bearer another"


@pytest.mark.parametrize("other", ['{"a":1}', "two words", "caf\u00e9"])
def test_a_cookie_of_another_program_on_this_host_signs_nobody_out(client: httpx.Client, other: str) -> None:
    header = f"theirs={other}; dohyo_token={fakes.TOKEN}; more=x".encode()
    assert client.get("/v1/echo", headers=[(b"cookie", header)]).json() == f"Bearer {fakes.TOKEN}"


@pytest.mark.parametrize("path", ["/worlds", "/worlds/wo-1", "/account", "/submit?challenge=autumn"])
def test_a_private_page_leads_a_visitor_without_a_token_to_sign_in_and_back(client: httpx.Client, path: str) -> None:
    led = client.get(path, headers=HTML)
    address = httpx.URL(led.headers["location"])
    assert (led.status_code, address.path, address.params["next"]) == (303, "/login", path)
    back = client.post("/login", data={"token": fakes.TOKEN, "next": address.params["next"]})
    assert back.headers["location"] == path
    assert client.get(path, headers=HTML).status_code == 200


@pytest.mark.parametrize(
    "headers",
    [
        {},
        {"sec-fetch-site": "same-origin"},
        {"x-dohyo-page": "1"},
        {"x-dohyo-page": "1", "sec-fetch-site": "cross-site"},
        {"x-dohyo-page": "1", "sec-fetch-site": "same-site"},
        {"x-dohyo-page": "1", "sec-fetch-site": "none"},
        {"x-dohyo-page": "1", "origin": "https://evil.example"},
        {"x-dohyo-page": "1", "origin": "null"},
        {"x-dohyo-page": "1", "origin": "http://["},
    ],
)
def test_a_change_that_no_own_page_sent_gets_no_token(client: httpx.Client, headers: dict[str, str]) -> None:
    sign_in(client)
    assert client.post("/v1/echo", headers=headers).json() is None
    assert client.delete("/v1/echo", headers=headers).json() is None


def test_a_change_sent_by_an_own_page_gets_the_token(client: httpx.Client, site: Site) -> None:
    sign_in(client)
    for proof in ({"sec-fetch-site": "same-origin"}, {"origin": site.origin}):
        assert client.post("/v1/echo", headers={"x-dohyo-page": "1"} | proof).json() == f"Bearer {fakes.TOKEN}"


def test_a_form_of_another_site_changes_nothing_in_a_browser(visit: Visitor, site: Site) -> None:
    page = visit().go("/login")
    page.get_by_label("Token").fill(fakes.TOKEN)
    page.keyboard.press("Enter")
    page.wait_for_url("**/")
    target = f"{site.origin}/v1/echo"
    page.goto("data:text/html,")  # another site
    page.set_content(f"<form method=post action={target}><button>win</button></form>")
    with page.expect_response(target) as answer:
        page.get_by_role("button", name="win").click()
    assert answer.value.json() is None


@pytest.mark.parametrize(
    "headers", [{"sec-fetch-site": "cross-site"}, {"origin": "https://evil.example"}, {"origin": "http://["}]
)
def test_a_form_of_another_site_signs_nobody_in_or_out(client: httpx.Client, headers: dict[str, str]) -> None:
    answer = sign_in(client, headers=headers)
    assert answer.status_code == 403
    assert "set-cookie" not in answer.headers
    assert "set-cookie" not in client.post("/logout", headers=headers).headers


@pytest.mark.parametrize("token", ["", "short", "with space in it", "é" * 20, "x" * 201, "line\nbreak-in-it"])
def test_what_is_no_token_is_refused_with_the_reason(client: httpx.Client, token: str) -> None:
    answer = sign_in(client, token)
    assert answer.status_code == 422
    assert "set-cookie" not in answer.headers
    assert "8 to 200 characters" in answer.text
    if token:
        assert token not in answer.text


@pytest.mark.parametrize(
    "target", ["https://evil.example", "//evil.example", "/\\evil.example", "javascript:1", "/\r\nx", "//["]
)
def test_signing_in_leads_nowhere_else(client: httpx.Client, target: str) -> None:
    answer = client.post("/login", data={"token": fakes.TOKEN, "next": target})
    assert answer.headers["location"] == "/"


def test_a_token_nobody_gave_out_is_refused(client: httpx.Client) -> None:
    answer = sign_in(client, "a-token-that-is-not-good")
    assert answer.status_code == 401
    assert "set-cookie" not in answer.headers
    assert "unknown, expired or revoked" in answer.text


def test_signing_out_forgets_the_token(client: httpx.Client) -> None:
    sign_in(client)
    client.post("/logout")
    assert client.get("/v1/me").status_code == 401


def test_a_browser_gets_errors_as_pages_and_a_program_as_documents(client: httpx.Client) -> None:
    page = client.get("/nothing", headers=HTML)
    assert page.status_code == 404
    assert "Page not found" in page.text
    assert client.get("/nothing").headers["content-type"].startswith("application/")
    assert client.get("/v1/nothing", headers=HTML).headers["content-type"].startswith("application/")


def test_a_defect_tells_nothing_of_itself(site: Site) -> None:
    for headers in (HTML, {}):  # the server closes the connection after each
        answer = httpx.get(site.origin + "/broken", headers=headers, trust_env=False, timeout=120)
        assert answer.status_code == 500
        assert "secret" not in answer.text


def test_names_in_addresses_cannot_leave_their_place(client: httpx.Client) -> None:
    page = client.get("/agents/%3C!--%3Cscript%3E%3Cb%3E", headers=HTML).text
    assert "<script><b>" not in page
    found = re.search(r'id="subject">(.*?)</script>', page)
    assert found is not None
    assert json.loads(found[1]) == "<!--<script><b>"


def test_pages_hold_no_inline_script_or_style(client: httpx.Client) -> None:
    for path in (
        "/",
        "/evaluations",
        "/episodes/x",
        "/compare",
        "/api",
        "/login",
        "/agents/a",
        "/challenges/a",
        "/join",
        "/nothing",
    ):
        text = client.get(path, headers=HTML).text
        assert "style=" not in text
        assert not re.search(r"\son\w+=", text)
        for attributes in re.findall(r"<script([^>]*)>", text):
            assert "src=" in attributes or "application/json" in attributes


def test_every_page_knows_every_mark(client: httpx.Client) -> None:
    text = client.get("/").text
    found = re.search(r'id="words">(.*?)</script>', text)
    assert found is not None
    assert set(json.loads(found[1])["marks"]) == {kind.value for kind in InfractionKind}


def test_agents_keep_the_colours_of_the_report(client: httpx.Client) -> None:
    assert client.get("/colours", params={"agent": '["reckless"]'}).json() == {"reckless": "#E69F00"}
    for nonsense in ("", "{", "7", '[1, null, {"a": 2}]', "[" * 20_000):
        assert client.get("/colours", params={"agent": nonsense}).json() == {}


def test_the_dashboard_shares_the_report_s_palette() -> None:
    root = Path(dashboard.__file__).parents[2]
    tokens = [
        dict(re.findall(r"(--[a-z-]+): (#[0-9A-F]{6})", scheme))
        for path in ("evaluation/report/templates/styles.css", "service/dashboard/static/styles.css")
        for scheme in (root / path).read_text().split("@media", 2)[:2]
    ]
    for report, ours in ((tokens[0], tokens[2]), (tokens[1], tokens[3])):
        assert report
        assert report.items() <= ours.items()
