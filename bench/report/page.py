"""Put the report's page together: the data as JSON, arrays in one compressed block.

Nothing that comes from a file becomes markup. The data are one JSON text in which no tag can begin or end, and
the script writes every name as text. The page's own policy forbids all other scripts and any network request.
"""

from __future__ import annotations

import base64
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import asdict, astuple
from typing import Any

import numpy as np
from markupsafe import Markup
from numpy.typing import ArrayLike

from tactsim.bench.kinds import PLANE
from tactsim.bench.pages import render
from tactsim.bench.report import REPORT_TITLE
from tactsim.bench.report.curves import below_bound, confusion_counts, curves, machine_line, points
from tactsim.bench.report.picture import plots
from tactsim.bench.report.recognition import Recognition, Replayed, drawing, map_outline, taxel_size
from tactsim.bench.runs import paper
from tactsim.bench.runs.pooled import Group, Pooled, figure_of, metric_of
from tactsim.bench.runs.tables import heading
from tactsim.bench.score import Metric, figures
from tactsim.core.errors import counted
from tactsim.estimators.filters.grid import TABLE_I
from tactsim.estimators.likelihoods.occupancy import OccupancyMap, log_odds

_ASSETS = "report/assets/"
_WHOLE = ("all_right_from", "settled_95")  # figures that the page shows of whole runs
_SEEN = (1, 2, 3, 5, 10)  # readings after which the headlines show the accuracy, beside the last
# What the names of protocols say, in the words of a heading.
_WORDS = {
    "test poses same": "tested at the poses of training",
    "test poses random": "tested at random poses",
    "test poses given": "tested at given poses",
    "test poses from a file": "tested on readings of a file",
    ", random order": ", touches in random order",
}

_SCRIPTS = ("base.js", "sorting.js", "tables.js", "recognition.js", "main.js")


class Arrays:
    """Arrays too large for JSON: their numbers are little-endian, one after the other, compressed together."""

    def __init__(self) -> None:
        self._content = bytearray()

    def add(self, values: ArrayLike, kind: str) -> dict[str, Any]:
        """Append an array as "u1", "i1", "u4" or "f4"; returns where it is."""
        array = np.ascontiguousarray(values, dtype=f"<{kind}")
        self._content += b"\0" * (-len(self._content) % 4)
        place = {"at": len(self._content), "kind": kind, "shape": list(array.shape)}
        self._content += array.tobytes()
        return place

    def text(self) -> str:
        """Give all arrays as base64 of a zlib stream."""
        return base64.b64encode(zlib.compress(bytes(self._content), 9)).decode()


def page(groups: Sequence[Group], replayed: Sequence[Replayed], remarks: Sequence[str]) -> str:
    """Make the HTML of a report. The same runs give the same page."""
    arrays = Arrays()
    names = {id(group): f"plots-{number}" for number, group in enumerate(groups)}
    entries = [entry for group in groups for entry in group.entries]
    data = {
        "machine": machine_line(entries),
        "versions": _versions(entries),
        "dates": sorted({str(entry.run.times.get("started", ""))[:10] for entry in entries} - {""}),
        "remarks": list(remarks),
        "figures": shown_figures(PLANE),
        "thing": "letter" if all(group.thing == "letter" for group in groups) else "object",
        "protocols": [
            _protocol(name, [group for group in groups if group.protocol == name], names, replayed, arrays)
            for name in dict.fromkeys(group.protocol for group in groups)
        ],
    }
    drawn: dict[str, Markup] = {}
    for group in groups:
        drawn |= plots(group, names[id(group)])
    return render(
        f"{_ASSETS}page.html",
        scripts=[_ASSETS + name for name in _SCRIPTS],
        styles=[f"{_ASSETS}page.css"],
        title=f"{REPORT_TITLE}{counted(sum(len(entry.runs) for entry in entries), 'run')}",
        plots=drawn,
        data=data,
        arrays=arrays.text(),
    )


def shown_figures(kind: str) -> dict[str, Any]:
    """List the figures that the page's tables at a chosen reading show: {name: how}; then those of whole runs."""
    return {
        name: {"heading": metric.column, **_how(metric), "section": metric.section}
        for name, metric in figures(kind).items()
        if metric.section or name in _WHOLE
    }


def _how(metric: Metric) -> dict[str, Any]:
    return {"digits": metric.digits, "better": metric.better}


def _headlines(group: Group) -> list[str]:
    """List the figures of the table that a task begins with."""
    readings = group.readings
    error = [f"error_mm@{readings}"] * group.places
    return [*(f"accuracy@{k}" for k in _SEEN if k < readings), f"accuracy@{readings}", *_WHOLE, *error, "ms"]


def _versions(entries: Sequence[Pooled]) -> str:
    lines = dict.fromkeys(
        ", ".join(f"{name} {number}" for name, number in sorted(entry.run.about["versions"].items()))
        + f", commit {entry.run.about['commit'] or 'unknown'}"
        for entry in entries
    )
    return "; ".join(lines)


def _protocol(
    name: str, groups: Sequence[Group], plots: Mapping[int, str], replayed: Sequence[Replayed], arrays: Arrays
) -> dict[str, Any]:
    methods = list(dict.fromkeys(method for group in groups for method in group.methods))
    mine = [one for one in replayed if any(one.entry in group.entries for group in groups)]
    shown: dict[str, dict[str, Any]] = {}
    for one in mine:
        for trial in one.recognitions:
            truth = trial.task.truth
            for label in (truth, *trial.label):
                if label not in shown and label in one.scan.letters:
                    shown[label] = _outline(one, label, arrays)
    return {
        "name": name,
        "title": _title(name),
        "methods": methods,
        "tasks": [{"plots": plots[id(group)], **_task(group, methods, arrays)} for group in groups],
        "replayedTask": next((g.task for g in groups if mine and mine[0].entry in g.entries), None),
        "recognitions": [_recognition(trial, one, arrays) for one in mine for trial in one.recognitions],
        "outlines": shown,
        "maps": _maps(mine, arrays),
    }


def _title(protocol: str) -> str:
    """Say in words what the name of a protocol means, for a heading."""
    for name, words in _WORDS.items():
        protocol = protocol.replace(name, words)
    return protocol[0].upper() + protocol[1:]


def _task(group: Group, methods: Sequence[str], arrays: Arrays) -> dict[str, Any]:
    keys = {id(entry): number for number, entry in enumerate(group.entries)}
    headlines = _headlines(group)
    return {
        "name": group.task,
        "readings": group.readings,
        "machine": machine_line(group.entries),
        "headlines": [{"heading": heading(figure), **_how(metric_of(figure))} for figure in headlines],
        "runs": [_run(entry, methods, headlines, arrays) for entry in group.entries],
        "notes": below_bound(group),
        "printed": [
            {**asdict(printed), "run": keys[id(entry)], "words": printed.words, "bins": _table_1(printed)}
            for entry in group.entries
            if (printed := paper.in_figure(entry.run)) is not None
        ],
        "pareto": [
            {
                "run": keys[id(point.entry)],
                "seconds": _short(point.seconds),
                "error": _short(point.error),
                "settled": point.settled,
                "errorFrontier": point.error_frontier,
                "settledFrontier": point.settled_frontier,
            }
            for point in points(group)
        ],
    }


def _table_1(printed: paper.Printed) -> str | None:
    """Say how Table I divides a histogram's bins over x, y and the angle; None of a filter without bins."""
    return " x ".join(map(str, TABLE_I[printed.amount])) if printed.option == "bins" else None


def _run(entry: Pooled, methods: Sequence[str], headlines: Sequence[str], arrays: Arrays) -> dict[str, Any]:
    run, values = entry.run, curves(entry)
    bands = {"accuracy": (values["accuracy_low"], values["accuracy_high"]), "error_mm": entry.error_band}
    letters, counts = confusion_counts(entry)
    trials = entry.trials
    answers = dict(zip(trials.truth.tolist(), trials.answer.tolist(), strict=True))
    return {
        "label": entry.label,
        "folder": str(entry.folder),
        "method": methods.index(entry.method),
        "budget": entry.budget.text if entry.budget else None,
        "description": run.about["description"],
        "letters": run.about["letters"],
        "trials": len(trials.truth),
        "scans": len(entry.runs),
        "readings": entry.readings,
        # By name: the values of each reading, and the ends of their intervals where they are known; or one value.
        "figures": {
            name: values[name]
            if name in _WHOLE
            else [_column(part) for part in (values[name], *bands.get(name, ()))]
            for name in shown_figures(PLANE)
        },
        "headlines": [[_short(part) for part in astuple(figure_of(entry, name))] for name in headlines],
        "bounded": any(value is not None for value in values["bound_mm"]),
        "confusion": {
            "letters": letters,
            "right": [letters.index(answers.get(letter, letter)) for letter in letters],
            "counts": arrays.add(counts, "u4"),
        },
    }


def _recognition(trial: Recognition, of: Replayed, arrays: Arrays) -> dict[str, Any]:
    plane = None
    if trial.plane is not None:
        first = trial.plane[0]
        peak = np.array([max(float(belief.probability.max()), 1e-300) for belief in trial.plane])
        share = np.stack([belief.probability for belief in trial.plane]) / peak[:, None, None, None]
        plane = {
            "labels": list(first.labels),
            "x": _column(first.x),
            "y": _column(first.y),
            "peak": arrays.add(peak, "f4"),
            # Square roots, so that a hundredth of the peak is still a tenth of the scale.
            "rootShare": arrays.add(np.round(255 * np.sqrt(share)), "u1"),
        }
    of_readings = {
        "pressures": trial.pressures, "sensor": trial.sensor_in_object, "ghost": trial.estimate_in_object,
        "probabilities": trial.probabilities, "pose": trial.robot_in_object, "truePose": trial.true_pose,
        "error": trial.error, "region": trial.region,
    }  # fmt: skip
    return {
        "run": trial.entry.label,
        "kind": trial.kind,
        "truth": trial.task.truth,
        "answer": trial.answer,
        "trial": trial.task.trial,
        "same": trial.same,
        "labels": list(trial.labels),
        "estimate": trial.label,
        "taxels": np.round(of.scan.taxel_xy, 4).tolist(),
        "taxelSize": taxel_size(of.scan),
        "unit": of.scan.meta.get("unit", "kPa"),
        **{
            name: None if values is None else arrays.add(values, "f4") for name, values in of_readings.items()
        },
        "radius": _column(None if np.isnan(radius) else radius for radius in trial.radius.tolist()),
        "plane": plane,
    }


def _outline(of: Replayed, label: str, arrays: Arrays) -> dict[str, Any]:
    drawn = drawing(label, of.scan, of.entry.run.shape_files)
    contours = map_outline(label, of.maps) if drawn is None else drawn
    return {
        "contours": [arrays.add(contour, "f4") for contour in contours],
        "radius": _short(max((float(np.hypot(*contour.T).max()) for contour in contours), default=0.0)),
        "drawn": drawn is not None,
    }


def _maps(replayed: Sequence[Replayed], arrays: Arrays) -> list[dict[str, Any]]:
    """List the different sets of maps, each with the runs that learned it."""
    found: dict[bytes, dict[str, Any]] = {}
    for one in replayed:
        if not one.maps:
            continue
        key = b"".join(chart.log_odds.tobytes() for chart in one.maps.values())
        if key not in found:
            found[key] = {"runs": [], **_map_set(one.maps, arrays)}
        found[key]["runs"].append(one.entry.label)
    return list(found.values())


def _map_set(maps: Mapping[str, OccupancyMap], arrays: Arrays) -> dict[str, Any]:
    charts = []
    for label, chart in maps.items():
        evidence = chart.log_odds - log_odds(chart.prior)
        limit = max(1.0, float(np.abs(evidence).max()))
        # Signed square roots: the outline shows beside the few cells that were felt most.
        root = 127 * np.sign(evidence) * np.sqrt(np.abs(evidence) / limit)
        width = chart.cell * evidence.shape[1]
        sizes = {"limit": _short(limit), "width": _short(width)}
        charts.append({"letter": label, **sizes, "root": arrays.add(np.round(root), "i1")})
    return {"charts": charts}


def _column(values: Any) -> list[float | None]:
    return [_short(value) for value in values]


def _short(value: float | None) -> float | None:
    """Round to six digits, which is more than a screen shows and half of what a float takes."""
    return None if value is None else float(f"{value:.6g}")
