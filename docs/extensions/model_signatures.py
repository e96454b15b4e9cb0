"""Signatures of pydantic models: names, types and defaults of the fields, without pydantic's bounds and patterns."""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel
from sphinx.application import Sphinx
from sphinx.util.typing import stringify_annotation


def signature(model: type[BaseModel]) -> str:
    """The fields as arguments; what is not required and has no plain default is left open."""
    fields = []
    for name, field in model.model_fields.items():
        kind = stringify_annotation(field.annotation, mode="smart").replace("~", "")
        default = "" if field.is_required() else f" = {field.default!r}" if field.default_factory is None else " = ..."
        fields.append(f"{name}: {kind}{default}")
    return f"(*, {', '.join(fields)})" if fields else "()"


def on_signature(app: Sphinx, what: str, name: str, found: Any, *rest: Any) -> tuple[str, None] | None:
    """Replaces the signature of a model; the rules of a field stand in its docstring."""
    if what == "class" and isinstance(found, type) and issubclass(found, BaseModel):
        return signature(found), None
    return None


def setup(app: Sphinx) -> dict[str, Any]:
    """Registers the extension."""
    app.connect("autodoc-process-signature", on_signature)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
