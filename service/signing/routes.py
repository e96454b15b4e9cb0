"""Public keys with which the service signs records."""

from __future__ import annotations

from fastapi import APIRouter

from dohyo.service.signing.views import SigningKeyView
from dohyo.service.state import ServicesOf
from dohyo.service.web.documents import problems

router = APIRouter(prefix="/v1/signing-key", tags=["episodes"], responses=problems())


@router.get("")
def get_signing_key(services: ServicesOf) -> SigningKeyView:
    """The keys that verify the header `dohyo-signature` of a record; needs no token."""
    return SigningKeyView(key=services.signing.public, retired=list(services.signing.retired))
