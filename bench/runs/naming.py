"""How runs are called: the method, which is an estimator with its options but without its budget, and the task."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from pathlib import PurePosixPath
from typing import Any, NamedTuple

from tactsim.bench.config import flat
from tactsim.bench.results import Run
from tactsim.core.checking import checked
from tactsim.press import WORLDS


class Budget(NamedTuple):
    """How much an estimator may compute: the option's name, its text and its size as one number."""

    option: str
    text: str
    amount: int


def budget(run: Run) -> Budget | None:
    """Say how much the estimator of a run was allowed to compute; None if it has no such option."""
    stated = run.about["budget"]
    if stated is None:
        return None
    option, value = stated["option"], str(stated["value"])
    # At most three numbers of nine digits each, so that a file cannot make their product enormous.
    counts = [int(digits) for digits in re.findall(r"\d{1,9}", value)[:3]]
    return Budget(option, f"{counts[0]:,}" if len(counts) == 1 else value, math.prod(counts))


def method_name(run: Run) -> str:
    """Name the estimator with those of its options that are no budget and no default."""
    stated = run.about["budget"] or {}
    settings = {name: value for name, value in run.about["settings"].items() if name != stated.get("option")}
    return ", ".join([run.estimator, *(f"{name} {value}" for name, value in settings.items())])


def task_name(run: Run, *, with_seed: bool = True) -> str:
    """Say in which motion, letters, readings and seed a run differs from the defaults; "defaults" if in none.

    Runs with one protocol and one task name saw the same readings; without the seed, readings of the same kind.
    """
    config = run.config
    files = ("scan", "train_scan", "train_presses", "presses")
    other = {name: config[name] for name in files if config.get(name)}
    if config.get("given"):
        other["readings"] = config["given"][:12]
    elif not (config.get("scan") or config.get("presses")):
        kind, of_scan = run.kind.scan_options, run.about["scan"].get("options", {})
        stated = checked(kind, of_scan, "the options of the run's scan")
        mine, standard = (flat(options.model_dump(mode="json")) for options in (stated, kind()))
        # test_poses is part of the protocol.
        other |= {k: v for k, v in mine.items() if k != "test_poses" and v != standard.get(k)}
        own = next((name for name in ("shapes", "meshes") if other.get(name)), None)
        if own is not None:  # of the user's own; that there is nothing beside them goes without saying
            other[own] = _in_folder(other[own])
            other = {k: v for k, v in other.items() if k not in ("letters", "objects") or v}
        if other.get("seed") == config["seed"]:
            del other["seed"]
    elif config.get("letters"):
        other["letters"] = config["letters"]
    words = [run.about["slip"]] if run.about.get("slip") else []
    for world, values in WORLDS.items():
        settings = flat(values)
        if settings and settings.items() <= other.items():
            words.append(world)
            other = {name: value for name, value in other.items() if name not in settings}
    if "seed" in other:
        words.append(f"scan's seed {other.pop('seed')}")
    if config["seed"] != 0 and with_seed:
        words.append(f"seed {config['seed']}")
    return ", ".join([*words, *(f"{name} {_word(value)}" for name, value in other.items())]) or "defaults"


def _in_folder(paths: Sequence[str]) -> str:
    """Name files, their folder once if they share it: examples/relief: cone.stl, dome.stl."""
    places = list(map(PurePosixPath, paths))
    if len({place.parent for place in places}) > 1 or len(places) == 1:
        return " ".join(paths)
    return f"{places[0].parent}: {', '.join(place.name for place in places)}"


def _word(value: Any) -> str:
    if not isinstance(value, list):
        return str(value)
    words = list(map(str, value))
    return _ranges(words) if all(len(word) == 1 for word in words) else " ".join(words)


def _ranges(letters: Sequence[str]) -> str:
    """Write letters as one types them: AEIOU, A-Z0-9."""
    parts: list[list[str]] = []
    for letter in letters:
        if parts and ord(letter) == ord(parts[-1][-1]) + 1:
            parts[-1].append(letter)
        else:
            parts.append([letter])
    return "".join(f"{part[0]}-{part[-1]}" if len(part) > 2 else "".join(part) for part in parts)
