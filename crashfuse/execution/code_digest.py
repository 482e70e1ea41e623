"""Digest of the code that computes a number: a cached result is reused only by code that would compute the same."""

import ast
import hashlib
import threading
from collections.abc import Iterator
from functools import cache
from importlib.util import find_spec
from pathlib import Path

_PACKAGE = Path(__file__).parents[1]
_NOT_COMPUTING = {"execution", "files", "errors", "wording", "version", "extensions", "results", "campaign_folder"}
"""Rooms that run, store, report and read, but determine no number: data are known by their fingerprint."""
_alone = threading.Lock()  # two threads that parse at once may make Python before 3.11.8 and 3.12.2 raise a SystemError


def code_digest(module: str, package: Path = _PACKAGE) -> str:
    """Digest of a module, given by its full name, and of every module of this package that it imports, even indirectly.

    Comments, docstrings and layout are ignored, and code that only runs or stores computations. Of another package
    every byte counts.
    """
    if module.partition(".")[0] != package.name:
        return hashlib.sha256(_foreign_sources(module) + sources_digest(package).encode()).hexdigest()
    waiting, digests = [module], {}
    while waiting:
        name = waiting.pop()
        if name in digests or (path := _source(name, package)) is None:
            continue
        digests[name], imports = _stripped(path)
        waiting += [other for other in imports if other.split(".")[1] not in _NOT_COMPUTING]
    return hashlib.sha256(repr((module, sorted(digests.items()))).encode()).hexdigest()


@cache
def sources_digest(package: Path = _PACKAGE) -> str:
    """Digest of every byte of the package's code, in a tenth of the time."""
    return hashlib.sha256(b"".join(path.read_bytes() for path in sorted(package.rglob("*.py")))).hexdigest()


def _foreign_sources(module: str) -> bytes:
    spec = find_spec(module.partition(".")[0])
    if spec is None or spec.origin is None:
        return module.encode()
    home = Path(spec.origin)
    files = sorted(home.parent.rglob("*.py")) if spec.submodule_search_locations else [home]
    return b"".join(path.read_bytes() for path in files)


def _source(module: str, package: Path) -> Path | None:
    top, *parts = module.split(".")
    path = package.joinpath(*parts)
    files = (path.with_suffix(".py"), path / "__init__.py") if top == package.name else ()
    return next((file for file in files if file.is_file()), None)


@cache
def _stripped(path: Path) -> tuple[str, tuple[str, ...]]:
    with _alone:
        tree = ast.parse(path.read_bytes())
    imports = tuple(_strip(tree))
    return hashlib.sha256(ast.dump(tree).encode()).hexdigest(), imports


def _strip(node: ast.AST) -> Iterator[str]:
    for field in ("body", "orelse", "finalbody", "handlers", "cases"):
        block = getattr(node, field, None)
        if not isinstance(block, list):  # a lambda's body, say
            continue
        block[:] = [s for s in block if not (isinstance(s, ast.Expr) and isinstance(s.value, ast.Constant))]
        for statement in block:
            if isinstance(statement, ast.ImportFrom) and (statement.module or "").startswith("crashfuse."):
                yield str(statement.module)
                yield from (f"{statement.module}.{alias.name}" for alias in statement.names)
            elif isinstance(statement, ast.Import):
                yield from (alias.name for alias in statement.names if alias.name.startswith("crashfuse."))
            yield from _strip(statement)
