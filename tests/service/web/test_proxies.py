"""Trusted proxies: a real proxy in a process of its own before a real service, and clients that forge its header."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import httpx
import pytest
from pydantic import ValidationError
from starlette.testclient import TestClient

from dohyo.service.settings import Settings
from dohyo.service.web.addresses import client_of
from dohyo.service.web.proxies import TrustedProxies
from tests.service.dashboard import fake
from tests.service.serving import Served, serving

GUIDE = Path(__file__).parents[3] / "docs/organisers/hosting.md"
SITE = "eval.example.org:8443"
PER_MINUTE = 30
PROXY_ADDRESS = "127.0.0.77"
# The clock of the rates stands still, so that a slow machine is allowed no request more.
NO_REFILL = """
from dohyo.service.web.limits import RateLimit
RateLimit.__init__.__defaults__ = (lambda: 0.0, 10_000)
"""
# A proxy as nginx is one: it appends the client's address to the header, and connects from an address of its own.
PROXY = """
import http.client, sys
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

class Proxy(BaseHTTPRequestHandler):
    def do_GET(self):
        onward = http.client.HTTPConnection("127.0.0.1", int(sys.argv[1]), source_address=(sys.argv[2], 0))
        told = ", ".join([*self.headers.get_all("x-forwarded-for", []), self.client_address[0]])
        onward.request("GET", self.path, headers={"x-forwarded-for": told})
        answer = onward.getresponse()
        body = answer.read()
        self.send_response(answer.status)
        self.send_header("content-length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)
        onward.close()
    def log_message(self, *_):
        pass

server = ThreadingHTTPServer(("127.0.0.1", 0), Proxy)
print(server.server_address[1], flush=True)
server.serve_forever()
"""


@contextmanager
def behind_a_proxy(data: Path, trusted: str) -> Iterator[tuple[Served, str]]:
    """A service, and the URL of the proxy before it."""
    given = {"DOHYO_TRUSTED_PROXIES": trusted, "DOHYO_REQUESTS_PER_MINUTE": str(PER_MINUTE)}
    before = f"import os; os.environ |= {given}\n{NO_REFILL}"
    with serving(data, before=before) as served:
        port = served.url.rpartition(":")[2]
        proxy = subprocess.Popen([sys.executable, "-c", PROXY, port, PROXY_ADDRESS], stdout=subprocess.PIPE, text=True)
        try:
            assert proxy.stdout is not None
            yield served, f"http://127.0.0.1:{proxy.stdout.readline().strip()}"
        finally:
            proxy.kill()
            proxy.wait()


def statuses(url: str, address: str, count: int, forged: bool = False) -> list[int]:
    """Of so many requests from an address."""
    with httpx.Client(transport=httpx.HTTPTransport(local_address=address), timeout=120) as client:
        headers = [{"x-forwarded-for": f"10.9.8.{number}"} if forged else {} for number in range(count)]
        return [client.get(f"{url}/v1/agents", headers=one).status_code for one in headers]


@pytest.mark.slow
def test_behind_a_trusted_proxy_each_client_has_a_limit_of_its_own(tmp_path: Path) -> None:
    with behind_a_proxy(tmp_path / "data", f"{PROXY_ADDRESS}/32") as (served, proxy):
        greedy = statuses(proxy, "127.0.0.5", 3 * PER_MINUTE, forged=True)
        assert greedy[:PER_MINUTE] == [200] * PER_MINUTE
        assert 429 in greedy
        assert statuses(proxy, "127.0.0.6", 5) == [200] * 5
        assert served.end() == 0
        logged = [line["address"] for line in served.log if line.get("path") == "/v1/agents"]
        assert set(logged) == {"127.0.0.5", "127.0.0.6"}


@pytest.mark.slow
def test_the_header_of_any_other_address_is_ignored_and_the_log_says_so_once(tmp_path: Path) -> None:
    with behind_a_proxy(tmp_path / "data", "10.0.0.0/8") as (served, proxy):
        assert 429 in statuses(served.url, "127.0.0.5", 3 * PER_MINUTE, forged=True)
        assert 429 in statuses(proxy, "127.0.0.6", 3 * PER_MINUTE)
        assert 429 in statuses(proxy, "127.0.0.7", 5)  # all clients of an unnamed proxy are one
        assert served.end() == 0
        warned = [line["message"] for line in served.log if "is ignored" in line["message"]]
        assert [re.search(r"of (\S+) is", one)[1] for one in warned] == ["127.0.0.5", PROXY_ADDRESS]  # type: ignore[index]
        assert all("DOHYO_TRUSTED_PROXIES" in one for one in warned)


def told_by_nginx(block: str) -> dict[str, str]:
    """Headers by which an nginx with these lines passes a request on, from a browser at `SITE`."""
    passed = re.search(r"^proxy_pass http://(.+);$", block, re.MULTILINE)
    assert passed is not None
    variables = {"$http_host": SITE, "$scheme": "https", "$proxy_add_x_forwarded_for": "203.0.113.7"}
    told = re.findall(r"^proxy_set_header (\S+) (\S+);$", block, re.MULTILINE)
    return {"host": passed[1]} | {name.lower(): variables[value] for name, value in told}


def test_behind_the_nginx_of_the_guide_sign_in_works_and_the_cookie_is_secure() -> None:
    (block,) = re.findall(r"^```\n(proxy_pass .+?)^```$", GUIDE.read_text(), re.MULTILINE | re.DOTALL)
    headers = told_by_nginx(block)
    behind = TrustedProxies(fake.create(), ("127.0.0.1",))
    browser = TestClient(behind, client=("127.0.0.1", 4000), follow_redirects=False)
    form = {"token": fake.TOKEN, "next": "/"}
    signed_in = browser.post("/login", data=form, headers=headers | {"origin": f"https://{SITE}"})
    assert signed_in.status_code == 303
    assert "secure" in re.split(r";\s*", signed_in.headers["set-cookie"].lower())
    assert f"https://{SITE}/v1" in browser.get("/api", headers=headers).text
    foreign = browser.post("/login", data=form, headers=headers | {"origin": "https://evil.example"})
    assert foreign.status_code == 403


def test_a_trusted_proxy_that_does_not_tell_the_scheme_is_logged_once(caplog: pytest.LogCaptureFixture) -> None:
    behind = TrustedProxies(fake.create(), ("127.0.0.1",))
    proxy = TestClient(behind, client=("127.0.0.1", 4000))
    told = {"x-forwarded-for": "203.0.113.7"}
    for headers in ({}, told | {"x-forwarded-proto": "https"}, told | {"x-forwarded-proto": "http"}):
        proxy.get("/login", headers=headers)
    assert caplog.messages == []
    for _ in range(2):
        proxy.get("/login", headers=told)
    (message,) = caplog.messages
    assert "127.0.0.1 sends no X-Forwarded-Proto" in message


@pytest.mark.parametrize("value", ["*", "proxy.example.org", "10.0.0.0/40"])
def test_what_names_no_network_is_refused(value: str) -> None:
    with pytest.raises(ValidationError, match=r"expected addresses or networks such as 172\.16\.0\.0/12"):
        Settings(trusted_proxies=(value,))


def test_proxies_are_separated_by_commas_or_written_in_json(monkeypatch: pytest.MonkeyPatch) -> None:
    for text in ("10.0.0.0/8, ::1", '["10.0.0.0/8", "::1"]'):
        monkeypatch.setenv("DOHYO_TRUSTED_PROXIES", text)
        assert Settings(_env_file=None).trusted_proxies == ("10.0.0.0/8", "::1")


@pytest.mark.parametrize(
    ("one", "other", "same"),
    [
        ("2001:db8::1", "2001:db8::ffff:1", True),
        ("2001:db8::1", "2001:db8:0:1::1", False),
        ("192.0.2.1", "::ffff:192.0.2.1", True),
        ("192.0.2.1", "192.0.2.2", False),
        ("unknown", "unknown", True),
    ],
)
def test_a_network_of_ipv6_is_one_client(one: str, other: str, same: bool) -> None:
    assert (client_of(one) == client_of(other)) is same
