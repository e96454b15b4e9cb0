"""The directive `every-module`: `automodule` for each module of a package, so that a new one needs no line here."""

from __future__ import annotations

import pkgutil
from importlib import import_module
from typing import Any

from docutils import nodes
from docutils.statemachine import StringList
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective


class EveryModule(SphinxDirective):
    """The modules of the package that is named, by name; packages in it and private modules are left out."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        """The modules' sections, as reStructuredText."""
        package = self.arguments[0]
        found = sorted(one.name for one in pkgutil.iter_modules(import_module(package).__path__) if not one.ispkg)
        lines = [line for name in found if name[0] != "_" for line in (f".. automodule:: {package}.{name}", "")]
        self.content = StringList(lines, source=package)
        return self.parse_content_to_nodes()


def setup(app: Sphinx) -> dict[str, Any]:
    """Registers the directive."""
    app.add_directive("every-module", EveryModule)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
