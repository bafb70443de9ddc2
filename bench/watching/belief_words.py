"""What is told of a belief, the same to a terminal, a page and a program that reads JSON."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from tactsim.bench.pad.simulated_hand import SimulatedHand
from tactsim.bench.placement import Properties, certainty, placement_error, properties
from tactsim.bench.report.recognition import drawing, map_outline
from tactsim.bench.results import BADLY_EXPLAINED
from tactsim.bench.watching.recogniser import Belief
from tactsim.bench.watching.touch_leader import LiveView, TouchLeader
from tactsim.bench.watching.web import numbers
from tactsim.core import Scan, compose
from tactsim.core.errors import counted
from tactsim.core.poses import FloatArray
from tactsim.core.source import Source
from tactsim.estimators import NONE
from tactsim.estimators.likelihoods.occupancy import OccupancyMap
from tactsim.hardware.sources import taxels_of
from tactsim.hardware.terminal_pictures import where


class BeliefWords:
    """Put beliefs into words and numbers.

    hidden: what is pressed, if that is simulated. outlines: by letter its contours, (k, 2) mm each, in its own frame.
    """

    def __init__(
        self,
        leading: TouchLeader,
        train: Scan,
        maps: Mapping[str, OccupancyMap],
        source: Source,
        from_behind: bool,
    ) -> None:
        self.leading, self.from_behind = leading, from_behind
        self.hidden = source if isinstance(source, SimulatedHand) else None
        self.letters = leading.recogniser.letters
        self.outlines = {label: drawing(label, train) or map_outline(label, maps) for label in self.letters}
        self._of: dict[str, Properties] = properties(train)
        self._taxels, self._places = source.pad.taxels, taxels_of(source)

    def line(self, belief: Belief) -> str:
        """Say in one line what is believed."""
        if belief.estimate is None:
            return "no touch yet"
        ranked = sorted(belief.estimate.probabilities.items(), key=lambda item: -item[1])
        letters = ", ".join(f"{label} {p:.3f}" for label, p in ranked[:3])
        return "; ".join([f"touch {len(belief.touches)}: {letters}", *self.details(belief)])

    def details(self, belief: Belief) -> list[str]:
        """Say how sure the place is, whether it is right where that is known, and how soon it was known."""
        values = self.json_of(belief)
        parts: list[str] = []
        if belief.estimate is None:
            return parts
        if values["within_mm"] is not None:
            parts.append(f"90 % sure of its place within {values['within_mm']:.2f} mm")
        if belief.estimate.unexplained:
            parts.append(f"the touches are {BADLY_EXPLAINED}")
        if self.hidden is not None:
            parts.append(self._verdict(values))
        if values["delay_ms"] is not None:
            parts.append(f"known {values['delay_ms']:.1f} ms after the touch")
        return parts

    def latency(self) -> str:
        """Say how soon after a touch it was known, over all touches: the mean and the slowest of a hundred, ms."""
        delays = 1e3 * np.array(self.leading.recogniser.delays)
        mean, slowest = delays.mean(), np.quantile(delays, 0.99)
        known = f"{counted(len(delays), 'touch')}, each known {mean:.1f} ms after it on average"
        return f"{known}, the slowest of a hundred {slowest:.1f} ms"

    def json_of(self, belief: Belief) -> dict[str, Any]:
        """Describe a belief by numbers: mm, rad, ms.

        unexplained, mean, covariance: see `Estimate`. within_mm: radius about the estimate that holds 90 % of the
        belief.
        """
        estimate = belief.estimate
        values: dict[str, Any] = {"touch": len(belief.touches)}
        if estimate is None:
            return values
        of, sure = self._of.get(estimate.label), None
        if of is not None and of.placed and estimate.samples is not None:
            sure = certainty(estimate, estimate.robot_in_object, of)
        mean, spread = estimate.mean, estimate.covariance
        values |= {
            "label": estimate.label,
            "probabilities": {label: float(p) for label, p in estimate.probabilities.items()},
            "robot_in_object": numbers(estimate.robot_in_object, 4),
            "sensor_in_robot": numbers(belief.touches[-1].sensor_in_robot, 4),
            "unexplained": round(float(estimate.unexplained), 3),
            "mean": None if mean is None else numbers(mean, 4),
            "covariance": None if spread is None else [numbers(row, 6) for row in spread],
            "within_mm": None if sure is None else round(float(sure.radius), 3),
            "delay_ms": None if belief.delay is None else round(1e3 * belief.delay, 1),
        }
        if self.hidden is not None:
            values["truth"] = self.hidden.label
            answer = self.hidden.label if self.hidden.label in self.letters else NONE
            values["right"] = estimate.label == answer
            values["error_mm"] = self._error(estimate.label, estimate.robot_in_object)
        return values

    def about(self) -> dict[str, Any]:
        """Tell a page once what it needs to draw beliefs."""
        lines = self.outlines.items()
        outlines = {label: [np.round(contour, 2).tolist() for contour in of] for label, of in lines}
        commands = list(self.leading.commands())
        return {"live": {"letters": self.letters, "outlines": outlines, "commands": commands}}

    def event(self, sent: dict[str, int]) -> dict[str, Any]:
        """Describe what is asked for, and the belief if it is another than the browser was `sent`; renews that."""
        view = self.leading.view()
        content: dict[str, Any] = {
            "phase": view.phase,
            "message": view.message,
            "progress": round(view.progress, 2),
            "where": self.where(view),
            "asked": self.asked_in_object(view),
        }
        if sent.get("belief") != view.number:
            sent["belief"] = view.number
            content["belief"] = self._drawn(view.belief)
        return {"live": content}

    def where(self, view: LiveView) -> str:
        """Say in words where the touch is that is asked for."""
        return "" if view.asked is None else where(view.asked, self.from_behind)

    def asked_in_object(self, view: LiveView) -> list[float | None] | None:
        """Give where the touch that is asked for lies on the most probable object, [x, y, theta]."""
        estimate = view.belief.estimate
        if view.asked is None or estimate is None or estimate.label == NONE:
            return None
        return numbers(compose(estimate.robot_in_object, view.asked), 3)

    def _drawn(self, belief: Belief) -> dict[str, Any]:
        values, places = self.json_of(belief), belief.sensor_in_object
        felt = np.full(self._taxels, np.nan)  # NaN where a taxel is left out
        if belief.touches:
            felt[self._places] = belief.touches[-1].pressures
        values["details"] = "; ".join(self.details(belief))
        values["felt"] = numbers(felt, 1) if belief.touches else None
        values["inObject"] = None if places is None else [numbers(place, 3) for place in places]
        return values

    def _error(self, label: str, robot_in_object: FloatArray) -> float | None:
        assert self.hidden is not None
        if label != self.hidden.label or label not in self._of or not self._of[label].placed:
            return None
        error = placement_error(robot_in_object, self.hidden.robot_in_object, self._of[label])
        return round(float(error), 3)

    def _verdict(self, values: Mapping[str, Any]) -> str:
        assert self.hidden is not None
        if not values["right"]:
            return f"wrong: it is {self.hidden.label}"
        error = values["error_mm"]
        return "right" + ("" if error is None else f", placed {error:.2f} mm off")
