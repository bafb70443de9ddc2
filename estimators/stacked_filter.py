"""The default: maps with several measurement models together, or images of whole presses where no pose is told."""

from __future__ import annotations

import copy
from collections import Counter
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field

from tactsim.core import InputError, Scan
from tactsim.core.poses import FloatArray
from tactsim.core.provenance import training_poses_unknown
from tactsim.estimators.estimator import Estimate, Estimator, Options, PlaneBelief, proposes_none
from tactsim.estimators.filters.refined import GradedOptions, RefinedFilter
from tactsim.estimators.filters.states import WeightedStates
from tactsim.estimators.likelihoods.folds import parts_of_presses
from tactsim.estimators.options import MODELS, MOTION

if TYPE_CHECKING:
    from tactsim.estimators.baselines.whole_image import WholeImage

# Images name objects where they name of so many left-out readings so many more rightly than maps do.
_TRIED, _BETTER = 40, 3
# Where presses that are stated at one pose vary by so much of what presses of all objects do, the pose is not theirs.
_UNLIKE = 1 / 3


class StackedOptions(GradedOptions):
    """Options of the coarse-to-fine filter on several measurement models together."""

    likelihood: str = Field("stacked", description=MODELS)
    motion: str = Field("seen", description=MOTION)


class StackedFilter(RefinedFilter):
    """The coarse-to-fine filter with pressures and their shares together, which notices an object that moves.

    Maps need poses. Where each object's training presses are stated at one pose, and the scan says that none is known
    or they are not alike, objects are named by the images of their presses, as `whole-image` does, and nothing is said
    of the place. Only maps tell "none of these", so `unknown` is refused there.

    Where they are alike, images name objects if they name left-out presses better than maps of one pose do.

    image: what names objects by their images; None where maps do. why: images do, in words; "" where maps do, None
    before `fit`.
    """

    options_type: type[Options] = StackedOptions
    minds_misfit = True
    draws = True  # once a motion is seen
    options: StackedOptions
    image: WholeImage | None = None
    why: str | None = None

    def __init__(self, options: StackedOptions) -> None:
        super().__init__(options)
        self._budget_of_maps = self.budget

    def fit(self, scan: Scan) -> None:
        """Learn maps and measurement models from the training readings, or their images; see `MapFilter.fit`.

        Raises InputError also where `unknown` asks for maps, and nobody knows the poses.
        """
        self.image, self.why = None, self._why_image(scan)
        self.budget = None if self.why else self._budget_of_maps
        if not self.why:
            super().fit(scan)
            return
        self._maps, self.pad_fit = {}, None
        self._fit_image(scan)

    def _fit_image(self, scan: Scan) -> None:
        from tactsim.estimators.baselines.whole_image import WholeImage

        self.image = WholeImage(Options())
        self.image.fit(scan)
        self.labels = self.image.labels

    def _why_image(self, scan: Scan) -> str:
        """Say why images are to name the objects, in words; "" if maps are."""
        train = scan.where("train")
        if not len(train) or not train.at_one_pose:
            return ""
        unknown = no_poses(train)
        if unknown and self.options.unknown:
            raise InputError(
                f"unknown: only maps tell that an object is none of those trained, and maps need poses, but {unknown}; "
                "leave unknown out"
            )
        return unknown or ("" if self.options.unknown else self._better_by_image(train))

    def _better_by_image(self, train: Scan) -> str:
        """Say by how much images name presses that are left out better than maps do, in words; "" if they do not."""
        from tactsim.estimators.baselines.whole_image import WholeImage

        part = parts_of_presses(train)
        by_label = np.argsort(train.labels, kind="stable")  # in whatever order objects are listed
        left_out = by_label[part[by_label] == 0]
        some = np.linspace(0, len(left_out) - 1, min(len(left_out), _TRIED)).round().astype(int)
        rest, out = train.chosen(part > 0), train.chosen(left_out[some])
        if rest.letters != train.letters or len(train.letters) < 2:
            return ""
        maps, image, rng = StackedFilter(self.options), WholeImage(Options()), np.random.default_rng(0)
        maps.why = ""
        RefinedFilter.fit(maps, rest)
        image.fit(rest)
        right = {maps: 0, image: 0}
        for estimator in right:
            for reading, pose, label in zip(out.readings, out.poses, out.labels.tolist(), strict=True):
                estimator.reset(rng)
                estimator.update(reading, pose)
                right[estimator] += estimator.estimate().label == label
        if right[image] - right[maps] < _BETTER:
            return ""
        return f"of {len(out)} left-out readings they name {right[image]} rightly, maps {right[maps]}"

    def fits_pad(self, scan: Scan) -> bool:
        """Tell whether units and options are fitted to a scan's pad; images are in any unit."""
        return super().fits_pad(scan) and not (self._why_image(scan) if self.why is None else self.why)

    def without(self, letter: str, scan: Scan) -> Estimator:
        """Give a filter of the other letters, by maps or images as this one; see `MapFilter.without`."""
        if self.image is None:
            return super().without(letter, scan)
        other = copy.copy(self)
        other._fit_image(scan.untrained([letter]))
        return other

    def reset(self, rng: np.random.Generator) -> None:
        """Forget the sequence: every state of every letter is equally probable again."""
        super().reset(rng) if self.image is None else self.image.reset(rng)

    def update(self, reading: ArrayLike, sensor_in_robot: ArrayLike) -> None:
        """Take in one reading (taxels,) at the pose sensor_in_robot [mm, mm, rad]; see `MapFilter.update`."""
        if self.image is None:
            super().update(reading, sensor_in_robot)
        else:
            self.image.update(reading, sensor_in_robot)

    def estimate(self) -> Estimate:
        """Give the letter's probabilities, and its pose if maps tell it."""
        return super().estimate() if self.image is None else self.image.estimate()

    @property
    def proposes(self) -> bool:
        """Tell whether the filter proposes readings: where it has maps."""
        return self.image is None

    def propose(self, candidates: Sequence[FloatArray] | FloatArray) -> int:
        """Choose among poses (n, 3); see `MapFilter.propose`. Raises InputError where it has no maps."""
        if self.image is not None:
            raise proposes_none("stacked, which knows no poses here,")
        return super().propose(candidates)

    def weighted_states(self) -> WeightedStates:
        """Give the belief as weighted states; see `MapFilter.weighted_states`. Raises InputError of images."""
        if self.image is not None:
            raise InputError(
                "stacked names objects by their images here, and holds no states; ask for its estimate"
            )
        return super().weighted_states()

    def belief_over_plane(self) -> PlaneBelief | None:  # type: ignore[override]
        """Show how the belief lies over the plane, mm; None of images."""
        return super().belief_over_plane() if self.image is None else None

    def describe(self) -> str:
        """Say in one line how the filter is set up."""
        if self.image is None:
            return super().describe()
        return f"by images of whole presses: {self.why}"

    @property
    def work(self) -> dict[str, Any]:
        """Count evaluations, as `RefinedFilter.work`; of images, what readings were compared with."""
        return super().work if self.image is None else self.image.work


def no_poses(presses: Scan) -> str:
    """Say why nobody knows where presses that are stated at one pose were taken, in words; "" if that may be known.

    It may where presses of an object are alike, whatever their strength. Of presses with several readings, as of
    several moments, the first are compared with the first, and so on.
    """
    letters = presses.letters
    if training_poses_unknown(presses.meta):
        return "nobody knows their poses"
    if len(letters) < 2:
        return ""
    strength = np.linalg.norm(presses.readings, axis=1, keepdims=True)
    images = presses.readings / np.where(strength > 0, strength, 1.0)
    count, number = Counter[int](), list[int]()
    for press in presses.press_numbers.tolist():
        number.append(count[press])
        count[press] += 1
    within = among = 0.0
    for first in range(max(number) + 1):
        alike = np.array(number) == first
        among += _squares(images[alike])
        for label in letters:
            own = images[alike & (presses.labels == label)]
            within += _squares(own) * len(own) / max(len(own) - 1, 1)
    if within <= _UNLIKE * among:
        return ""
    return (
        f"those of an object are stated at one pose, but differ {within / among:.2f} times as much as those of all "
        f"objects do, where at most {_UNLIKE:.2f} are alike"
    )


def _squares(images: FloatArray) -> float:
    """Sum the squares of what images (n, taxels) differ from their mean; 0 of none."""
    return float(((images - images.mean(axis=0)) ** 2).sum()) if len(images) else 0.0
