"""Delivery: signed messages to webhooks about ended evaluations, repeated until they are accepted.

Each webhook has a task of its own with one message at a time, and each message has limited time in all, so that a slow
receiver delays only its own messages. A message is stored in the database before it is sent, so that a service that
dies meanwhile sends it after its restart. A message may arrive twice; its `Dohyo-Delivery` header is then the same.
"""

from __future__ import annotations

import asyncio
import contextlib
import hashlib
import hmac
import ipaddress
import json
import logging
import re
import socket
import time
from collections.abc import Collection, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Any, Final
from urllib.parse import urlsplit

import httpx
from sqlalchemy.exc import SQLAlchemyError

from dohyo.service.periodic import ended
from dohyo.service.state import Services
from dohyo.service.webhooks import queries as webhooks
from dohyo.service.webhooks.model import Delivery, Webhook
from dohyo.sumo_networks.errors import InvalidInputError

POLL_S: Final = 2.0
TIMEOUT_S: Final = 10.0  # for one message in all: name, connection, and the head of the answer
AT_ONCE: Final = 256
RESOLVERS: Final = 32  # threads that ask for addresses; a name server may be as slow as a receiver
# IPv6 addresses that a translator or a tunnel turns into an IPv4 address, perhaps of a private network; and the former
# addresses of sites, which Python calls global.
INNER: Final = tuple(
    ipaddress.ip_network(one)
    for one in (
        *("64:ff9b::/96", "64:ff9b:1::/48", "2002::/16", "2001::/32", "::/96", "::ffff:0:0:0/96"),
        "fec0::/10",
    )
)
LABEL: Final = re.compile(r"[A-Za-z0-9_-]{1,63}")
LONGEST_NAME: Final = 253

logger = logging.getLogger("dohyo.webhooks")


def check_url(url: str, *, private_allowed: bool) -> None:
    """Refuses an impossible URL by its text alone; the address behind its name is checked at every delivery.

    Raises:
        InvalidInputError: Another scheme than https (or http), an impossible name, credentials, or no public address.
    """
    try:
        parts = urlsplit(url)
        host, _ = parts.hostname, parts.port
    except ValueError as error:
        raise InvalidInputError(f"webhook: {error}") from error
    try:
        name = httpx.URL(url).raw_host.decode("ascii")  # it sends, and refuses more
    except httpx.InvalidURL as error:
        raise InvalidInputError(f"webhook: {error}") from error
    if parts.scheme not in ("https", "http") or not host or not url.isprintable():
        raise InvalidInputError("webhook: expected a URL such as https://example.org/hook")
    if ":" not in name and not _is_name(name.removesuffix(".")):
        raise InvalidInputError(f"webhook: '{host[:LONGEST_NAME]}' is no name of a machine")
    if parts.username is not None or parts.password is not None:
        raise InvalidInputError("webhook: expected a URL without user and password")
    if private_allowed:
        return
    if host == "localhost" or host.endswith((".localhost", ".local", ".internal")) or _is_private(host):
        raise InvalidInputError(f"webhook: '{host}' is not a public address")


def signature(secret: str, timestamp: int, body: bytes) -> str:
    """The `Dohyo-Signature` header: HMAC-SHA256 over "TIMESTAMP.BODY" under the webhook's secret."""
    signed = hmac.new(secret.encode(), f"{timestamp}.".encode() + body, hashlib.sha256).hexdigest()
    return f"t={timestamp},v1={signed}"


async def public_address(
    host: str, port: int, *, private_allowed: bool, resolvers: ThreadPoolExecutor | None = None
) -> str:
    """One of a name's addresses, all of which must be public.

    Args:
        host: Name or address.
        port: Port.
        private_allowed: Whether all addresses are allowed.
        resolvers: Threads in which to ask; None: those of the loop.

    Raises:
        InvalidInputError: An address is not public, or the name has none.
    """
    loop, ask = asyncio.get_running_loop(), partial(socket.getaddrinfo, host, port, type=socket.SOCK_STREAM)
    try:
        found = await loop.run_in_executor(resolvers, ask)
    except OSError as error:
        raise InvalidInputError(f"'{host}' has no address") from error
    addresses = [str(entry[4][0]) for entry in found]
    if not private_allowed and any(_is_private(address) for address in addresses):
        raise InvalidInputError(f"'{host}' leads to an address that is not public")
    return addresses[0]


class Deliverer:
    """Sends messages in the background during the app's lifespan."""

    def __init__(self, services: Services) -> None:
        self.services = services
        self._task: asyncio.Task[None] | None = None
        self._client: httpx.AsyncClient | None = None
        self._under_way: dict[str, asyncio.Task[None]] = {}  # by webhook
        self._ended = asyncio.Event()
        self._resolvers = ThreadPoolExecutor(RESOLVERS, "webhook-names")

    async def start(self) -> None:
        """Starts the background task."""
        # The environment of this machine is ignored: no proxy, no stored credentials.
        context = httpx.create_ssl_context(trust_env=False)
        if (own := self.services.settings.webhook_authorities) is not None:
            context.load_verify_locations(own)
        limits = httpx.Limits(max_connections=AT_ONCE, max_keepalive_connections=0)
        self._client = httpx.AsyncClient(
            verify=context, trust_env=False, follow_redirects=False, timeout=TIMEOUT_S, limits=limits
        )
        self._task = asyncio.create_task(self._run(), name="webhooks")

    async def stop(self) -> None:
        """Stops the tasks; unsent messages are sent after the next start."""
        tasks = [*self._under_way.values(), *([self._task] if self._task is not None else [])]
        for task in tasks:
            task.cancel()
        await ended(tasks, logger)
        self._resolvers.shutdown(wait=False, cancel_futures=True)
        if self._client is not None:
            await self._client.aclose()

    async def _run(self) -> None:
        while True:
            self._ended.clear()
            try:
                due = await asyncio.to_thread(self._due, tuple(self._under_way))
            except SQLAlchemyError as error:
                logger.warning("the database refused: %s", type(error).__name__)
                due = []
            except Exception:  # a defect; the messages of all webhooks must not wait for a restart
                logger.exception("the due messages cannot be read, trying again in %g s", POLL_S)
                due = []
            for delivery, webhook in due:
                task = asyncio.create_task(self._deliver(delivery, webhook), name=f"webhook {webhook.id}")
                self._under_way[webhook.id] = task
                task.add_done_callback(partial(self._forget, webhook.id))
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(self._ended.wait(), POLL_S)

    def _forget(self, webhook_id: str, _: asyncio.Task[None]) -> None:
        del self._under_way[webhook_id]
        self._ended.set()

    def _due(self, but: Collection[str]) -> Sequence[tuple[Delivery, Webhook]]:
        database = self.services.database
        with database.reading() as session:
            news = bool(webhooks.unannounced(session))
        if news:
            with database.session() as session:
                webhooks.announce(session)
        with database.reading() as session:
            return webhooks.due_deliveries(session, AT_ONCE - len(but), but=but)

    async def _deliver(self, delivery: Delivery, webhook: Webhook) -> None:
        status, failure = 0, None
        try:
            async with asyncio.timeout(TIMEOUT_S):
                status = await self._post(delivery, webhook)
        except TimeoutError:
            failure = f"no answer within {TIMEOUT_S:g} s"
        except InvalidInputError as error:
            failure = str(error)
        except Exception as error:  # whatever it is: a delivery that is not settled would be due again at once
            failure = type(error).__name__
        else:
            failure = None if 200 <= status < 300 else f"it answered {status}"
        logger.info("webhook", extra={"facts": {"delivery": delivery.id, "webhook": webhook.id, "failure": failure}})

        def settle() -> None:
            with self.services.database.session() as session:
                webhooks.settle(session, delivery.id, failure, final=status == 410)

        try:
            await asyncio.to_thread(settle)
        except SQLAlchemyError as error:
            logger.warning("the database refused: %s", type(error).__name__)
            await asyncio.sleep(POLL_S)  # it is due again, and is sent twice
        except Exception:
            logger.exception("delivery %s cannot be settled", delivery.id)
            await asyncio.sleep(POLL_S)  # the same; else it would be due again at once

    async def _post(self, delivery: Delivery, webhook: Webhook) -> int:
        """Sends once to the checked address: the name is not resolved a second time."""
        url = httpx.URL(webhook.url)
        port = url.port or (443 if url.scheme == "https" else 80)
        allowed = self.services.settings.webhook_private_addresses
        address = await public_address(url.host, port, private_allowed=allowed, resolvers=self._resolvers)
        body = json.dumps(delivery.body, separators=(",", ":")).encode()
        headers = {
            "host": url.netloc.decode("ascii"),
            "content-type": "application/json",
            "user-agent": "dohyo",
            "dohyo-delivery": delivery.id,
            "dohyo-signature": signature(webhook.secret, int(time.time()), body),
        }
        extensions: dict[str, Any] = {"sni_hostname": url.host}
        client = self._client
        if client is None:
            raise InvalidInputError("the service is ending")
        target = url.copy_with(host=address)
        # The answer's body is never read, since it may be endless.
        async with client.stream("POST", target, content=body, headers=headers, extensions=extensions) as answer:
            return answer.status_code


def _is_name(name: str) -> bool:
    """Whether a text can be the name of a machine: labels of 1 to 63 letters, digits, '-' and '_'."""
    return len(name) <= LONGEST_NAME and all(LABEL.fullmatch(label) for label in name.split("."))


def _is_private(host: str) -> bool:
    """Whether a host is an address that is not public; a name is not an address."""
    try:
        address = ipaddress.ip_address(host.partition("%")[0])
    except ValueError:
        return False
    if address.version == 6 and any(address in network for network in INNER):
        return True
    mapped = getattr(address, "ipv4_mapped", None)
    return not (mapped or address).is_global or address.is_multicast
