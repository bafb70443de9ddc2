"""Write down, as text, all that a user can call: verbs, lists, options, tasks and public names.

    python tests/goldens/inventory.py > today.txt                                  # of the tactsim that is imported
    python tests/goldens/inventory.py --compare tests/goldens/inventory-0.1.txt    # what was added and taken away

`inventory-0.1.txt` is that of commit 95d8bf5. Lines are compared as a set within each section, so that an order that
changed says nothing. Exit status: 1 if a line of the old inventory is gone or changed.
"""

from __future__ import annotations

import argparse
import inspect
import json
import os
import re
import subprocess
import sys
from importlib import import_module
from pathlib import Path
from typing import Any

COLUMNS = 250  # so wide that no help is broken into lines
SECTIONS = (
    "",
    "estimators",
    "letters",
    "solids",
    "worlds",
    "scan-options",
    "solid-options",
    "slip",
    "metrics",
)
LISTS = (*SECTIONS, "suites", "formats")
# What the documentation, the templates of `bench new`, examples/ and the tutorials import or name.
NAMES = {
    "tactsim": "*",
    "tactsim.core": "*",
    "tactsim.models": "*",
    "tactsim.press": "*",
    "tactsim.press.space": "*",
    "tactsim.estimators": "*",
    "tactsim.estimators.contract": "*",
    "tactsim.env": "*",
    "tactsim.bench.tasks": "*",
    "tactsim.bench.cli": "main",
    "tactsim.bench.cli.app": "VERBS load",
    "tactsim.bench.formats": "read write",
    "tactsim.bench.certainty": "covariance",
    "tactsim.bench.leaderboard.bundle": "read_bundle",
    "tactsim.bench.places": "check_new_folder",
    "tactsim.bench.run": "Run",
    "tactsim.bench.runner": "perform",
    "tactsim.bench.score": "CURVES HEADLINES",
    "tactsim.bench.space.space_config": "space_config",
    "tactsim.bench.space.space_runner": "perform_in_space",
    "tactsim.bench.tasks.data": "check_data",
    "tactsim.core.counters": "Counters",
    "tactsim.core.errors": "InputError short unknown",
    "tactsim.core.files": "new_folder",
    "tactsim.core.forward": "ForwardModel",
    "tactsim.core.moments": "at_load with_moments",
    "tactsim.core.reading": "Reading",
    "tactsim.core.source": "HasPad Log NoReading Source SourceEnded SourceError",
    "tactsim.env.learned_policy": "LearnedPolicy",
    "tactsim.env.policies": "InformationPolicy RandomPolicy",
    "tactsim.env.policy_table": "play",
    "tactsim.estimators.likelihoods.likelihood": "Likelihood",
    "tactsim.estimators.registry": "BUILT_IN load",
    "tactsim.hardware.codecs.codec": "Codec CodecFormat Frame",
    "tactsim.hardware.device": "load_device",
    "tactsim.hardware.recorded": "Replay",
    "tactsim.hardware.recording": "Recorder",
    "tactsim.hardware.sources": "open_source names",
    "tactsim.press.scan_poses": "stage_for",
    "tactsim.press.simulated_source": "open_source",
    "tactsim.press.touches": "Touches",
}


def bench(*words: str) -> str:
    """Return what a verb prints, as a user calls it; its error where it fails."""
    call = [sys.executable, "-c", "from tactsim.bench.cli import main; main()", *words]
    environment = os.environ | {"COLUMNS": str(COLUMNS), "NO_COLOR": "1", "TERM": "dumb"}
    done = subprocess.run(call, env=environment, capture_output=True, text=True, check=False)
    text = done.stdout if done.returncode == 0 else f"exit status {done.returncode}: {done.stderr}"
    return "\n".join(" ".join(line.strip(" │").split()) for line in text.splitlines())


def schema(model: Any) -> str:
    """List the fields of a pydantic model: name, type, default, bounds."""
    whole = model.model_json_schema()
    found: list[str] = []

    def walk(part: dict[str, Any], prefix: str) -> None:
        for name, field in part.get("properties", {}).items():
            reference = field.get("$ref") or (field.get("allOf") or [{}])[0].get("$ref")
            rest = {key: value for key, value in sorted(field.items()) if key not in ("title", "description")}
            if reference:
                walk(whole["$defs"][reference.rpartition("/")[2]], f"{prefix}{name}.")
            else:
                found.append(f"{prefix}{name}: {json.dumps(rest, sort_keys=True)}")

    walk(whole, "")
    return "\n".join(found)


def signature(name: str, thing: Any) -> str:
    """Say what a name is: a function or class with its parameters, without their types; the members of a class."""

    def called(item: Any) -> str:
        try:
            parameters = inspect.signature(item).parameters.values()
        except (TypeError, ValueError):
            return "(...)"
        words = ", ".join(str(parameter.replace(annotation=parameter.empty)) for parameter in parameters)
        return f"({re.sub(' at 0x[0-9a-f]+', '', words)})"

    if inspect.isclass(thing):
        members = sorted(
            member
            for member in {*dir(thing), *getattr(thing, "__annotations__", {})}
            if not member.startswith(("_", "model_"))
            and not any(
                member in vars(base) for base in thing.__mro__ if not base.__module__.startswith("tactsim")
            )
        )
        return "\n".join([f"{name}: class", *(f"{name}.{member}" for member in members)])
    return f"{name}{called(thing)}" if callable(thing) else f"{name}: {type(thing).__name__}"


def public(module: str, words: str) -> str:
    """List public names of a module: those given, or `__all__`."""
    try:
        home = import_module(module)
        names = sorted(home.__all__) if words == "*" else words.split()
    except (ImportError, AttributeError) as error:
        return f"missing: {type(error).__name__}"
    lines = []
    for name in names:
        try:
            lines.append(signature(name, getattr(home, name)))
        except (ImportError, AttributeError):
            lines.append(f"{name}: missing")
    return "\n".join(lines)


def inventory() -> dict[str, str]:
    """Make every section, by its title."""
    from tactsim.bench.cli.app import VERBS
    from tactsim.bench.config import RunConfig
    from tactsim.bench.tasks import names as tasks
    from tactsim.bench.tasks import task
    from tactsim.core import Pad
    from tactsim.estimators import names
    from tactsim.estimators.registry import load
    from tactsim.press import ScanOptions
    from tactsim.press.space import SpaceOptions

    found = {"bench --help": bench("--help")}
    found |= {f"bench {verb} --help": bench(verb, "--help") for verb in VERBS}
    found |= {f"bench list {section}".strip(): bench("list", *section.split()) for section in LISTS}
    found |= {f"bench list estimators {name}": bench("list", "estimators", name) for name in names()}
    found |= {f"options of {name}": schema(load(name).options_type) for name in names()}
    for model in (ScanOptions, SpaceOptions, RunConfig, Pad):
        found[f"fields of {model.__name__}"] = schema(model)
    found |= {
        f"task {name}": json.dumps(task(name).model_dump(mode="json"), sort_keys=True, indent=0)
        for name in tasks()
    }
    return found | {f"names of {module}": public(module, words) for module, words in NAMES.items()}


def text_of(sections: dict[str, str]) -> str:
    """Write sections below each other."""
    return "".join(f"## {title}\n{body.strip()}\n\n" for title, body in sections.items())


def sections_of(text: str) -> dict[str, str]:
    """Read what `text_of` wrote."""
    return {part.partition("\n")[0]: part.partition("\n")[2] for part in text.split("## ") if part.strip()}


def main() -> int:
    """Print the inventory, or how it differs from a file."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--compare", type=Path, help="an inventory to compare with")
    asked = parser.parse_args()
    now = sections_of(text_of(inventory()))
    if not asked.compare:
        print(text_of(now), end="")
        return 0
    before, gone_any = sections_of(asked.compare.read_text()), False
    for title in [*before, *(title for title in now if title not in before)]:
        old, new = (side.get(title, "").splitlines() for side in (before, now))
        gone, added = ([line for line in one if line not in other] for one, other in ((old, new), (new, old)))
        gone_any |= bool(gone)
        if gone or added:
            print(
                f"## {title}", *(f"- {line}" for line in gone), *(f"+ {line}" for line in added), "", sep="\n"
            )
    return int(gone_any)


if __name__ == "__main__":
    sys.exit(main())
