"""The lock files: one version of a package for everybody, each with its hashes."""

import re
import tomllib
from collections import defaultdict

import pytest
from building import ROOT
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

# A file of pins, and the groups of pyproject.toml that it serves.
MAIN, DEVELOPMENT = ROOT / "requirements.lock", ROOT / "requirements-dev.lock"
LOCKS = [
    MAIN,
    DEVELOPMENT,
    *sorted(ROOT.glob("*/requirements*.lock")),
    *sorted(ROOT.glob("*/*/requirements*.lock")),
]
LOCKS = [path for path in LOCKS if not path.relative_to(ROOT).parts[0].startswith(".")]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))


def pins_of(path):
    """Give the pins of a package, as `version ; marker`, and the number of hashes of each."""
    text = path.read_text(encoding="utf-8").replace("\\\n", " ")
    found = defaultdict(dict)
    for line in text.splitlines():
        if pin := re.match(r"([\w.-]+)==(\S+)\s*(;.*?)?\s*(?=--hash|$)", line):
            found[canonicalize_name(pin[1])][f"{pin[2]} {pin[3] or ''}".strip()] = line.count(
                "--hash=sha256:"
            )
    return found


def wanted(*groups):
    """Name the packages that groups of pyproject.toml ask for."""
    names = set()
    for group in groups:
        for entry in PROJECT["dependency-groups"][group]:
            if isinstance(entry, dict):
                names |= wanted(entry["include-group"])
            else:
                names.add(canonicalize_name(Requirement(entry).name))
    return names


DEPENDENCIES = {
    canonicalize_name(Requirement(entry).name): Requirement(entry)
    for entry in PROJECT["project"]["dependencies"]
}


@pytest.mark.parametrize("path", LOCKS, ids=lambda path: str(path.relative_to(ROOT)))
def test_every_pin_has_its_hashes(path):
    pins = pins_of(path)
    assert pins
    assert all(hashes for versions in pins.values() for hashes in versions.values())


@pytest.mark.parametrize("path", LOCKS, ids=lambda path: str(path.relative_to(ROOT)))
def test_no_two_locks_disagree(path):
    pins, others = pins_of(path), pins_of(DEVELOPMENT)
    versions = {name: {pin.split()[0] for pin in found} for name, found in pins.items()}
    for name in pins.keys() & others.keys():
        assert versions[name] <= {pin.split()[0] for pin in others[name]}, name


def test_what_a_run_needs_is_part_of_what_development_needs():
    main, development = pins_of(MAIN), pins_of(DEVELOPMENT)
    assert main.keys() < development.keys()
    assert main.keys() >= DEPENDENCIES.keys() | wanted("build")
    assert development.keys() >= wanted("dev")
    tools = wanted("dev") - wanted("build") - DEPENDENCIES.keys()
    assert not main.keys() & tools, "`make run` would install what only development needs"


def test_a_pin_is_one_that_the_project_allows():
    for name, requirement in DEPENDENCIES.items():
        for pin in pins_of(MAIN)[name]:
            assert requirement.specifier.contains(pin.split()[0]), f"{name} {pin}: run `make lock`"
