"""Tell what is missing for a release: `make release-check`. docs/developers/releasing.md says what a person does."""

from __future__ import annotations

import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

import yaml

from tactsim.bench.leaderboard.bundle import read_record
from tactsim.core.errors import InputError

ROOT = Path(__file__).resolve().parents[2]


def faults(root: Path) -> Iterator[str]:
    """Say in a line each what is not as a release needs it, in the repository at `root`."""
    version = tomllib.loads(read(root, "pyproject.toml"))["project"]["version"]
    citation = yaml.safe_load(read(root, "CITATION.cff"))
    if not re.fullmatch(r"\d+\.\d+\.\d+", version):
        yield f"pyproject.toml: version {version} is none of a release; write MAJOR.MINOR.PATCH"
    recipe = yaml.safe_load(read(root, "recipe/recipe.yaml"))["context"]["version"]
    for name, other in (("CITATION.cff", citation["version"]), ("recipe/recipe.yaml", recipe)):
        if str(other) != version:
            yield f"{name}: version {other}, and pyproject.toml says {version}"
    yield from of_changelog(read(root, "CHANGELOG.md"), version, str(citation.get("date-released")))
    if not re.fullmatch(r"10\.\d+/\S+", str(citation.get("doi"))):
        yield "CITATION.cff: no doi; reserve one for the archive of this version"
    yield from of_tables(root)
    yield from of_leaderboard(root)
    yield from of_git(root, version)


def read(root: Path, name: str) -> str:
    """Read a file of the repository."""
    return (root / name).read_text(encoding="utf-8")


def of_changelog(text: str, version: str, released: str) -> Iterator[str]:
    """Check that the newest section is this version's, of the day that the citation says, and nothing is above it."""
    unreleased, *sections = re.split(r"^## ", text, flags=re.M)[1:]
    if not unreleased.startswith("Unreleased\n") or unreleased.removeprefix("Unreleased").strip():
        yield "CHANGELOG.md: what is under Unreleased belongs under this version"
    title = sections[0].splitlines()[0] if sections else "none"
    wanted = f"{version} - {released}"
    if title != wanted:
        yield f"CHANGELOG.md: the newest version is {title!r}, not {wanted!r}, as in CITATION.cff's date-released"


def of_tables(root: Path) -> Iterator[str]:
    """Check that all tables that sweeps have filled are of one commit, which is part of this one's history."""
    pages = [root / "README.md", *sorted((root / "docs").rglob("*.md"))]
    commits: dict[str, str] = {}
    for page in pages:
        for found in re.findall(
            r"^\*`bench sweep .*commit (\w+)\.\*$", page.read_text(encoding="utf-8"), re.M
        ):
            commits.setdefault(found, str(page.relative_to(root)))
    if len(commits) > 1:
        said = ", ".join(f"{commit} in {page}" for commit, page in commits.items())
        yield f"the tables are of several commits: {said}; `make tables` on one of them"
    for commit, page in commits.items():
        if git(root, "merge-base", "--is-ancestor", commit, "HEAD") is None:
            yield f"{page}: a table is of commit {commit}, which is none before this one"


def of_leaderboard(root: Path) -> Iterator[str]:
    """Check that every bundle of results/leaderboard was verified as it is, and confirmed."""
    for bundle in sorted((root / "results" / "leaderboard").glob("*.tar.xz")):
        try:
            record = read_record(bundle)
        except InputError as error:
            yield str(error)
            continue
        if record is None:
            yield f"{bundle.relative_to(root)} was not verified: `bench verify --record`"
        elif not record.verified:
            yield f"{bundle.relative_to(root)} could not be confirmed: {record.said}"


def of_git(root: Path, version: str) -> Iterator[str]:
    """Check that all is committed, and that the tag is free or already here."""
    if changed := git(root, "status", "--porcelain"):
        yield f"{changed.splitlines()[0].strip()} and perhaps more is not committed"
    tagged = git(root, "rev-list", "-n", "1", f"v{version}")
    if tagged and tagged != git(root, "rev-parse", "HEAD"):
        yield f"the tag v{version} is another commit's: raise the version"


def git(root: Path, *words: str) -> str | None:
    """Give what git prints; None if it fails."""
    done = subprocess.run(["git", *words], cwd=root, text=True, capture_output=True, check=False)
    return None if done.returncode else done.stdout.strip()


if __name__ == "__main__":
    found = list(faults(ROOT))
    for fault in found:
        print(fault)
    sys.exit(1 if found else None)
