"""The page of a method: what it is, how it did on each task, with which code and where, and how to run it again."""

from __future__ import annotations

import json
import shlex
from collections.abc import Iterable, Mapping
from typing import Any
from xml.etree.ElementTree import Element

from tactsim.bench.leaderboard.bundle import DONE
from tactsim.bench.leaderboard.curve_drawing import curve
from tactsim.bench.leaderboard.figure_words import heading, rank, text_of
from tactsim.bench.leaderboard.markup import h
from tactsim.bench.leaderboard.standings import Entrant, Standings
from tactsim.bench.leaderboard.task_page import check_tag, columns

_AT = (1, 2, 3, 5, 7, 10, 15, 20, 30, 40, 60, 100, 150)  # readings at which a curve is drawn


def method_page(
    entries: Iterable[tuple[Standings, Entrant]],
    pages: Mapping[tuple[str, str], str],
    files: Mapping[Entrant, str],
) -> list[Element]:
    """Make the parts of the page, one for each task that the method entered.

    pages: of the tasks, by name and data. files: of the bundles.
    """
    parts = []
    for of, one in entries:
        link = h("a", {"href": f"../{pages[of.task, of.data]}"}, of.task)
        score = (
            _score(of, one)
            if one.status == DONE
            else [h("p", {"class": "remark"}, f"No score: {one.status}.")]
        )
        bundle = h("a", {"href": f"../{files[one]}", "download": ""}, "Download the bundle")
        parts.append(
            h(
                "section",
                {"class": "block"},
                h("h2", {}, link, "" if of.known else " (a task or data of another version)"),
                *score,
                h("h3", {}, "Run it again"),
                h("pre", {}, h("code", {}, command(one))),
                h("h3", {}, "What ran"),
                _facts(one),
                h("p", {}, bundle, ": every estimate of every trial."),
            )
        )
    return parts


def _score(of: Standings, one: Entrant) -> list[Element]:
    readings = [at for at in sorted({*_AT, of.readings}) if at <= of.readings]
    drawn = [("share of trials right", "accuracy", True), ("placement error, mm", "error_mm", False)]
    curves = [
        curve(words, readings, [one.figure(f"{name}@{at}") for at in readings], one.number, share=share)
        for words, name, share in drawn
    ]
    figures = [
        part
        for figure in columns(of)
        for part in (h("dt", {}, heading(figure)), h("dd", {}, text_of(one.figure(figure), figure)))
    ]
    return [
        h("p", {}, f"Rank {rank(one.rank)} of {len(of.ranked)}, by {heading(of.by)}. ", check_tag(one)),
        h("div", {"class": "figures"}, *curves),
        h(
            "p",
            {"class": "hint"},
            "Bands: 95 % intervals over scans and trials. Error where the letter is right.",
        ),
        h("details", {}, h("summary", {}, "All figures"), h("dl", {}, *figures)),
    ]


def command(one: Entrant) -> str:
    """Write the command that does these trials again; every name in it is quoted for a shell."""
    bundle = one.bundle
    words = ["bench", "submit", bundle.task, "--estimator", bundle.estimator, "--title", bundle.method]
    for name, value in bundle.options.items():
        words += ["--set", f"{name}={_option(value)}"]
    words += [] if bundle.reproducible else ["--not-reproducible"]
    return shlex.join([*words, "--out", one.path.name])


def _option(value: Any) -> str:
    """Write the value of an option as `--set` reads it."""
    if value is None:
        return "none"
    return value if isinstance(value, str) else json.dumps(value)


def _facts(one: Entrant) -> Element:
    bundle = one.bundle
    options = ", ".join(f"{name} {_option(value)}" for name, value in bundle.options.items())
    facts = {
        "estimator": bundle.estimator,
        "from": bundle.package or "tactsim itself",
        "options given": options or "none: the defaults",
        "described as": bundle.runs[0].about["description"] if bundle.runs else None,
        "reproducible": "yes: the same bits again"
        if bundle.reproducible
        else "no: within what chance allows",
        "made": bundle.made,
        "commit of tactsim": bundle.commit or "unknown",
        "hash of the source": bundle.source_hash,
        "hash of the readings": bundle.task_data,
        "versions": ", ".join(f"{name} {version}" for name, version in bundle.versions.items()),
        "checked": _checked(one),
        "machine": f"{bundle.machine['processor']}, {bundle.machine['cores']} cores, {bundle.machine['system']}",
    }
    return h(
        "dl",
        {},
        *(part for name, value in facts.items() if value for part in (h("dt", {}, name), h("dd", {}, value))),
    )


def _checked(one: Entrant) -> str:
    if one.check is None:
        return "not yet"
    check = one.check
    chosen = "" if check.seed is None else f", with --seed {check.seed}"
    by = f"by commit {check.commit or 'unknown'} on {check.machine.processor}, {check.made}{chosen}"
    return f"{check.said}: {check.again} of {check.trials} trials were done again {by}"
