"""Hash the source code that a result depends on, so that results of different code are never confused.

Imports are followed by reading the files, inside `tactsim` and inside the package that is asked about. Imports
within functions count too. A name that a package re-exports is followed to the module that defines it. The
hash covers compiled code, so comments, docstrings and formatting do not count.

Compiling all files takes as long as a short run's trials, so what was found in a file is kept, by the file's content
and the version of Python, in the cache folder.
"""

from __future__ import annotations

import ast
import hashlib
import json
import subprocess
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import asdict, dataclass
from functools import cache, lru_cache
from importlib.util import find_spec
from pathlib import Path
from types import CodeType
from typing import Any

from tactsim.core.cache_folder import cache_folder
from tactsim.core.errors import InputError
from tactsim.core.files import read_bytes, write_text

_OWN = "tactsim"
_MOST_FILES = 1000  # of which is kept what was found in them
_LARGEST = 1 << 24  # bytes


def source_digest(*modules: str) -> str:
    """Hash these modules and all that they import of tactsim and of their own packages: 64 hex digits.

    A module without a file of Python source, as in a notebook, counts by its name alone.
    """
    content = hashlib.sha256()
    for name, digest in sorted(source_of(*modules).items()):
        content.update(f"{name} {digest}\n".encode())
    _keep()
    return content.hexdigest()


def source_of(*modules: str) -> dict[str, str]:
    """Find the modules that `source_digest` hashes, each with the digest of its file."""
    packages = {_OWN, *(name.partition(".")[0] for name in modules)}
    parsed = cache(_parsed)  # so that every file is looked at once
    found: dict[str, str] = {}
    left = list(modules)
    while left:
        name = left.pop()
        if name in found:
            continue
        path = _file(name)
        if path is None:
            found[name] = ""
            continue
        file = parsed(path)
        found[name] = file.digest
        left += _modules((one for one in file.imports(name) if one[0].partition(".")[0] in packages), parsed)
    return found


@lru_cache(maxsize=1)
def git_commit() -> str | None:
    """Name the checked-out commit of tactsim, with "-changed" appended if a file differs from it.

    None without git, or if tactsim is installed and not checked out.
    """
    here = Path(__file__)
    git = ["git", "-C", str(here.parent)]
    try:
        # An installed package may lie within a checkout of something else.
        subprocess.run(
            [*git, "ls-files", "--error-unmatch", here.name], capture_output=True, timeout=10, check=True
        )
        described = subprocess.run(
            [*git, "describe", "--always", "--abbrev=40", "--exclude=*", "--dirty=-changed"],
            capture_output=True, text=True, timeout=10, check=True,
        )  # fmt: skip
    except (OSError, subprocess.SubprocessError):
        return None
    return described.stdout.strip() or None


def short_commit(commit: str | None) -> str:
    """Write a commit, as `git_commit` names it, in the 12 digits that a page shows; "unknown" where there is none."""
    return (commit or "unknown")[:12]


@dataclass(frozen=True)
class _Import:
    """One imported name, as the syntax tree has it.

    level: the number of leading dots of a relative import, 0 for an absolute one. bound: the name that the
    importing module gives it.
    """

    level: int
    module: str
    name: str | None
    bound: str


@dataclass(frozen=True)
class _File:
    """A parsed file: the digest of its code, and what it imports."""

    package: bool
    digest: str
    imported: tuple[_Import, ...]

    @classmethod
    def stated(cls, values: dict[str, Any]) -> _File:
        """Take a file from JSON. Raises KeyError or TypeError for what is none, such as another version's."""
        imported = tuple(_Import(**one) for one in values["imported"])
        return cls(values["package"], values["digest"], imported)

    def imports(self, name: str) -> Iterator[tuple[str, str | None]]:
        """Give the imports of the module called `name` as (module, name in it), both absolute."""
        for one in self.imported:
            yield self.absolute(name, one)

    def absolute(self, name: str, one: _Import) -> tuple[str, str | None]:
        """Write one import of the module called `name` without dots in front."""
        if not one.level:
            return one.module, one.name
        parts = name.split(".")
        base = parts[: len(parts) - one.level + self.package]
        return ".".join([*base, *filter(None, [one.module])]), one.name


def _modules(imports: Iterable[tuple[str, str | None]], parsed: Callable[[Path], _File]) -> Iterator[str]:
    """Find the modules in which imported names are defined."""
    for module, name in imports:
        if name is None or _file(module) is None:
            yield module
        elif _file(f"{module}.{name}") is not None:
            yield f"{module}.{name}"
        else:
            file = parsed(_file(module) or Path())
            passed_on = [one for one in file.imported if one.bound == name] if file.package else []
            yield from _modules([file.absolute(module, passed_on[0])], parsed) if passed_on else [module]


@lru_cache(maxsize=4096)
def _file(name: str) -> Path | None:
    """Find the file of a module, without importing anything; None if it has no Python source."""
    top, *parts = name.split(".")
    folder = _folder(top)
    if folder is None:
        return None
    if folder.is_file():
        return None if parts else folder
    for path in (folder.joinpath(*parts, "__init__.py"), folder.joinpath(*parts).with_suffix(".py")):
        if path.is_file():
            return path
    return None


@lru_cache
def _folder(top: str) -> Path | None:
    """Find the folder of a package, or the file of a module that is in none."""
    try:
        spec = find_spec(top)
    except (ImportError, ValueError):  # such as __main__ in a notebook
        return None
    if spec is None:
        return None
    if spec.submodule_search_locations:
        return Path(next(iter(spec.submodule_search_locations)))
    return Path(spec.origin) if spec.origin and spec.origin.endswith(".py") else None


def _parsed(path: Path) -> _File:
    state = path.stat()
    return _parse(path, state.st_mtime_ns, state.st_size)


@lru_cache(maxsize=2048)
def _parse(path: Path, mtime: int, size: int) -> _File:
    """Parse a file. The time and size are part of the cache's key, so that a changed file is parsed again."""
    source = path.read_bytes()
    package = path.name == "__init__.py"
    key = hashlib.sha256(f"{sys.version} {package} {_FOUND}\n".encode() + source).hexdigest()
    try:
        return _File.stated(_kept()[key])
    except (KeyError, TypeError):
        pass
    tree = ast.parse(source)
    imported = tuple(_imports(tree.body))
    content = hashlib.sha256()
    # Level 2 leaves out docstrings.
    for word in _words(compile(tree, "", "exec", dont_inherit=True, optimize=2)):
        content.update(word)
    file = _File(package, content.hexdigest(), imported)
    _new[key] = asdict(file)
    return file


_FOUND = 2  # raised when something else is found in a file than before
_new: dict[str, dict[str, Any]] = {}  # parsed now, and not yet kept


@cache
def _kept() -> dict[str, Any]:
    """Read what was found in files before; nothing if that cannot be read, or is not what was written."""
    with suppress(InputError):
        said, _, content = read_bytes(_place(), _LARGEST).partition(b"\n")
        if said == hashlib.sha256(content).hexdigest().encode():
            return json.loads(content)
    return {}


def _keep() -> None:
    """Keep what was found in files for the next process; where that cannot be, it is found again."""
    if _new:
        kept = _kept()
        kept.update(_new)
        _new.clear()
        for oldest in list(kept)[:-_MOST_FILES]:
            del kept[oldest]
        content = json.dumps(kept)
        with suppress(InputError):
            write_text(_place(), f"{hashlib.sha256(content.encode()).hexdigest()}\n{content}")


def _place() -> Path:
    return cache_folder() / "sources"


def _imports(statements: Iterable[ast.AST]) -> Iterator[_Import]:
    """Find the imports among statements and within them, but for those that only a type checker makes."""
    for statement in statements:
        if isinstance(statement, ast.If) and ast.unparse(statement.test) == "TYPE_CHECKING":
            yield from _imports(statement.orelse)
        elif isinstance(statement, ast.Import):
            for alias in statement.names:
                yield _Import(0, alias.name, None, alias.asname or alias.name)
        elif isinstance(statement, ast.ImportFrom):
            for alias in statement.names:
                yield _Import(statement.level, statement.module or "", alias.name, alias.asname or alias.name)
        else:
            for part in ("body", "orelse", "finalbody", "handlers", "cases"):
                inner = getattr(statement, part, None)
                if isinstance(inner, list):
                    yield from _imports(inner)


def _words(code: CodeType) -> Iterator[bytes]:
    """Write code without line numbers: instructions, names, constants and the code within."""
    yield repr((code.co_name, code.co_flags, code.co_argcount, code.co_kwonlyargcount)).encode()
    yield code.co_code
    yield repr((code.co_names, code.co_varnames, code.co_freevars, code.co_cellvars)).encode()
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _words(constant)
        elif isinstance(constant, frozenset):
            yield repr(sorted(map(repr, constant))).encode()
        else:
            yield repr(constant).encode()
