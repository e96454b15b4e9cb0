"""Addresses: which of them count as one client, and who a request counts for."""

from __future__ import annotations

import ipaddress
from functools import lru_cache

from fastapi import Request


@lru_cache(maxsize=4096)
def client_of(address: str) -> str:
    """The client that an address stands for: itself, or its network of 64 bits, all of which one host of IPv6 has."""
    try:
        parsed = ipaddress.ip_address(address)
    except ValueError:
        return address
    if isinstance(parsed, ipaddress.IPv4Address):
        return address
    if parsed.ipv4_mapped is not None:
        return str(parsed.ipv4_mapped)
    return str(ipaddress.ip_network((int(parsed), 64), strict=False))


def payer_of(request: Request) -> str:
    """Owner whose token a request has; without a token, the client."""
    caller = getattr(request.state, "caller", None)
    host = request.client.host if request.client is not None else "unknown"
    return f"address {client_of(host)}" if caller is None else f"owner {caller.owner}"
