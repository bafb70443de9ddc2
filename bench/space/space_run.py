"""`SpaceRun`: a finished run with objects in space, its curves and trials."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactsim.bench.space.space_plan import SpacePlan
from tactsim.bench.space.space_score import summarise
from tactsim.bench.space.space_trials import SpaceTrials
from tactsim.bench.space.surface_distance import Surface
from tactsim.core.errors import counted
from tactsim.core.poses import FloatArray
from tactsim.estimators.space.surface import Surface as LearnedSurface


@dataclass(frozen=True, eq=False)
class Shape:
    """What a run keeps of an object: its mesh, for pictures, and its surface, for the distance.

    vertices: (v, 3) mm in the object frame. faces: (f, 3) numbers of vertices, counter-clockwise from outside.
    """

    vertices: FloatArray
    faces: NDArray[np.int64]
    surface: Surface


@dataclass(frozen=True, eq=False, repr=False)
class SpaceRun:
    """A finished run with objects in space: what was asked, what came out, and how good it is.

    config: the configuration. about: versions, machine, the estimator's description and options. shapes: each object.
    work: counts of what was done and skipped. trials: the raw result. times: seconds of each stage and peak memory.
    plan: what is needed to do trials again; a loaded run has none. maps: the surfaces that the estimator learned, if
    it has; a loaded run has none.
    """

    config: dict[str, Any]
    about: dict[str, Any]
    shapes: dict[str, Shape]
    work: dict[str, Any]
    trials: SpaceTrials
    times: dict[str, Any]
    plan: SpacePlan | None = None
    maps: Mapping[str, LearnedSurface] = field(default_factory=dict)

    @cached_property
    def surfaces(self) -> dict[str, Surface]:
        """Give what the distance needs of each object."""
        return {label: shape.surface for label, shape in self.shapes.items()}

    @cached_property
    def summary(self) -> dict[str, Any]:
        """Every metric by name, computed from the trials: lists over the touch count, and headlines."""
        return summarise(self.trials, self.surfaces)

    @property
    def touches(self) -> int:
        """The number of touches of a trial."""
        return self.trials.label.shape[1]

    def as_json(self) -> dict[str, Any]:
        """Put the run into one flat object, as `bench run --task solids --json` prints it."""
        asked = ("task", "estimator", "trials", "touches", "seed", "explore", "hand")
        found = ("objects", "options", "description", "protocol", "versions", "machine")
        return {
            **self.summary,
            **{name: self.config[name] for name in asked},
            **{name: self.about[name] for name in found},
            "seconds": self.times["seconds"],
            "peak_memory_mb": self.times["peak_memory_mb"],
            "work": self.work,
        }

    def save(self, folder: str | Path) -> Path:
        """Write the run's files and pictures to a new folder, whole or not at all, and return its path.

        Raises InputError if the folder holds something or cannot be written.
        """
        from tactsim.bench.space.space_results import save

        return save(self, Path(folder))

    def __repr__(self) -> str:
        """Say in one line what was tried and how it ended."""
        summary = self.summary
        error = summary["error_mm"][-1]
        return (
            f"<SpaceRun of {self.config['estimator']}, {counted(len(self.trials.truth), 'trial')} of "
            f"{self.touches} touches over {' '.join(self.about['objects'])}: accuracy {summary['accuracy'][-1]:.3f}"
            + ("" if error is None else f", surface distance {error:.2f} mm")
            + ">"
        )
