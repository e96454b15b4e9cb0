"""Answer of the signing route."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from dohyo.service.web.views import View


class SigningKeyView(View):
    """Public keys of the service. A record's signature by any of them is the service's."""

    algorithm: Annotated[Literal["Ed25519"], Field(description="Signature scheme, RFC 8032.")] = "Ed25519"
    key: Annotated[
        str,
        Field(
            description="The key that signs: 32 bytes as base64.",
            examples=["11qYAYKxCrfVS/7TyWQHOg7hcvPapiMlrwIaaPcHURo="],
        ),
    ]
    retired: Annotated[list[str], Field(description="Earlier keys whose signatures still count.")]
