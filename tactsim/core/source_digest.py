"""Hash the source code that a result depends on, so that results of different code are never confused.

What counts is every file of Python of the installed package, byte by byte: simple, and never too little. The commit is
noted beside it, and is not enough: files may differ from it, and an installed package has none.
"""

from __future__ import annotations

import hashlib
import os
import subprocess
from functools import cache
from importlib.util import find_spec
from pathlib import Path


def source_digest(*modules: str) -> str:
    """Hash the files of tactsim and of the packages that these modules are in: 64 hex digits.

    A module without a file of Python source, as in a notebook, counts by its name alone.
    """
    packages = sorted({"tactsim", *(name.partition(".")[0] for name in modules)})
    return hashlib.sha256("\n".join(map(package_digest, packages)).encode()).hexdigest()


@cache
def package_digest(package: str, holding: bytes = b"") -> str:
    """Hash a package's name and those of its Python files that hold some bytes: 64 hex digits.

    Files count as they are at the first call in a process.
    """
    content = hashlib.sha256(package.encode())
    for name, path in python_files(package):
        source = Path(path).read_bytes()
        if holding in source:
            content.update(f"\n{name} {len(source)}\n".encode() + source)
    return content.hexdigest()


def python_files(package: str) -> list[tuple[str, str]]:
    """List the files of Python of a package: (name within it, path). Nothing is imported.

    Of a module that is in no package it is the module's own file; there is none of one without source.
    """
    try:
        spec = find_spec(package)
    except (ImportError, ValueError):  # such as __main__ in a notebook
        return []
    if spec is None:
        return []
    if not spec.submodule_search_locations:
        return [(package, spec.origin)] if spec.origin and spec.origin.endswith(".py") else []
    return sorted(
        (os.path.relpath(path, top), path)
        for top in spec.submodule_search_locations
        for folder, _, names in os.walk(top, followlinks=True)  # the rooms of a checkout are links
        for path in (f"{folder}/{name}" for name in names if name.endswith(".py"))
    )


@cache
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
