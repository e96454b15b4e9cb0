"""Sources: the files that define an agent, so that records distinguish an edited agent from the old one."""

from __future__ import annotations

import ast
import inspect
import re
import sys
from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path

_NAMED = re.compile(r"(\w+(?:\.\w+)+)(?::\w+)?")


def source_files(kind: type) -> tuple[Path, ...]:
    """The file that defines a class, and all files of its package that it imports, directly or indirectly.

    The package is everything under the first part of the module's name; for agents of dohyo it is their floor. Imports
    are read from the source and nothing is executed. Imports inside functions count, and so do modules named by a
    string ("package.module" or "package.module:Class"). Files with only a docstring are left out, and so are other
    packages, whose versions a record states.

    Args:
        kind: Class of the agent.

    Returns:
        The file of the class, then the others in the order of their modules' names.

    Raises:
        TypeError: The class has no file, such as a class defined at a prompt.
        OSError: A file cannot be read.
    """
    own = Path(inspect.getfile(kind))
    root = _root(kind.__module__)
    package = getattr(sys.modules.get(root), "__path__", None)
    if kind.__module__ == root or not package:
        return (own,)
    found: dict[str, Path] = {}
    waiting = [kind.__module__]
    while waiting:
        module = waiting.pop()
        path = _file_of(module, root, Path(package[0]))
        if module in found or path is None:
            continue
        found[module] = path
        waiting += [
            name for name in _mentioned(module, path) if f"{name}.".startswith(f"{root}.") and name not in found
        ]
    others = [path for name, path in sorted(found.items()) if path != own and _imports(*_state(path)) is not None]
    return (own, *others)


def _root(module: str) -> str:
    """The package whose files may be part of an agent: within dohyo only the floor of the agent."""
    parts = module.split(".")
    return ".".join(parts[: 2 if parts[0] == "dohyo" else 1])


def _file_of(module: str, root: str, package: Path) -> Path | None:
    place = package.joinpath(*module.removeprefix(root).split(".")[1:])
    for path in (place / "__init__.py", place.with_name(f"{place.name}.py")):
        if path.is_file() and (path.parent == package or package in path.parents):
            return path
    return None


def _mentioned(module: str, path: Path) -> Iterator[str]:
    """Absolute names of modules that may be loaded with a module: its packages and its imports."""
    parts = module.split(".")
    yield from (".".join(parts[:count]) for count in range(1, len(parts)))
    here = parts if path.name == "__init__.py" else parts[:-1]
    for level, name, members in _imports(*_state(path)) or ():
        base = [*here[: len(here) - level + 1], *([name] if name else [])] if level else [name]
        yield ".".join(base)
        yield from (".".join([*base, member]) for member in members)


def _state(path: Path) -> tuple[Path, int, int]:
    state = path.stat()
    return path, state.st_mtime_ns, state.st_size


@lru_cache(maxsize=1024)
def _imports(path: Path, _mtime_ns: int, _size: int) -> tuple[tuple[int, str, tuple[str, ...]], ...] | None:
    """Level, module and members of every import of a file; None if the file has only a docstring."""
    try:
        tree = ast.parse(path.read_bytes())
    except (SyntaxError, ValueError):
        return ()
    if not tree.body or (len(tree.body) == 1 and ast.get_docstring(tree) is not None):
        return None
    found: list[tuple[int, str, tuple[str, ...]]] = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found += [(0, alias.name, ()) for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            found.append((node.level, node.module or "", tuple(alias.name for alias in node.names)))
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and (named := _NAMED.fullmatch(node.value)):
            found.append((0, named[1], ()))
    return tuple(found)
