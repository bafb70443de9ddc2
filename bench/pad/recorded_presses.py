"""Press what was recorded once more, at the recorded poses: what the simulated pad would have read."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tactsim.bench.pad.alignment import check_labels_apart, refuse_presses
from tactsim.core import InputError, Scan
from tactsim.core.checking import checked
from tactsim.core.idle import find_idle
from tactsim.core.poses import FloatArray, compose
from tactsim.hardware.sensor_fit import Guess
from tactsim.hardware.taxel_fit import untouched
from tactsim.models.letter import Letter
from tactsim.press.bed import lay_bed, levels
from tactsim.press.engine import press_at
from tactsim.press.scan_options import ScanOptions
from tactsim.press.scanning import letters_of
from tactsim.press.touches import Pressed, Touches

_GRAZES = 0.2  # of what most presses feel at most: one that is to feel less is not judged by its picture
# Of what most feel at most; the least cosine with what is pressed in the simulation.
_IDLE, _FITS = 0.05, 0.05
_LEAST_AREA = 0.3  # of a letter's, that is left of it if its outline is moved inwards


class PressesAsRecorded:
    """Predict what the simulated pad reads at the poses of a recorded scan."""

    def __init__(self, simulated: Scan, recorded: Scan) -> None:
        stated = simulated.meta.get("options")
        if not isinstance(stated, dict):
            raise InputError("the simulated scan does not say how it was made; make it with `bench scan`")
        self.options = checked(ScanOptions, stated, "simulated scan")
        self._letters = {letter.name: letter for letter in letters_of(self.options)}
        unknown = [name for name in recorded.letters if name not in self._letters]
        if unknown:
            raise InputError(
                f"{unknown[0]!r} was recorded but not simulated; press it with `bench scan --letters` or --shape"
            )
        self._recorded = recorded
        pad = self.options.pad.taxel_xy
        apart = np.abs(recorded.taxel_xy[:, None] - pad[None]).max(axis=-1)
        if apart.min(axis=1).max() > 1e-3:
            raise InputError("the recorded taxels are not where the simulated pad has them: the pads differ")
        self.taxels = apart.argmin(axis=1)
        self._pressed: tuple[tuple[object, ...], dict[str, Pressed]] | None = None

    @property
    def stated(self) -> Guess:
        """Give the simulation's own parameters."""
        press = self.options.press
        wrist = np.inf if press.wrist_stiffness is None else press.wrist_stiffness
        return Guess(self.options.sensor.psf_sigma, press.stiffness, wrist)

    @property
    def level(self) -> FloatArray:
        """Give the errors (n, 5) of presses that are just as stated."""
        errors = np.zeros((len(self._recorded), 5))
        errors[:, 3:] = self.options.press.tilt_x, self.options.press.tilt_y
        return errors

    def bending(self) -> float:
        """Average the second moment of the area that touches over both axes and all presses, mm^4."""
        moments = []
        for name in self._recorded.letters:
            poses = self._recorded.poses[self._recorded.labels == name]
            bed = lay_bed(levels(self._letters[name], self.options.press), poses, *self.options.cell_lines)
            area = bed.area_of_presses
            for along in bed.centroid.T:
                sums = [np.bincount(bed.press, bed.area * along**power, len(poses)) for power in (1, 2)]
                first, second = sums
                moments.append((second - first**2 / np.maximum(area, 1e-9))[area > 0])
        every = np.concatenate(moments)
        if not len(every):
            raise InputError("nothing touches the pad at the recorded poses: are the poses right?")
        return max(float(every.mean()), 1e-3)

    def __call__(self, guess: Guess, errors: FloatArray) -> FloatArray:
        """Predict readings without imperfections; see `tactsim.hardware.sensor_fit.Predict`."""
        wrist = None if np.isinf(guess.wrist) else guess.wrist
        held = {"stiffness": guess.stiffness, "wrist_stiffness": wrist, "engine": "auto"}
        held["dynamics"] = "equilibrium"  # a recorded press is one at rest
        press = self.options.press.model_copy(update=held)
        sensor = self.options.sensor.model_copy(update={"psf_sigma": guess.psf_sigma})
        options = self.options.model_copy(update={"sensor": sensor, "press": press})
        ideal = np.empty((len(errors), options.pad.taxels))
        for name, pressed in self._press(errors, options, guess).items():
            readings = pressed.readings(options)
            readings[list(pressed.blanks)] = np.nan
            ideal[self._recorded.labels == name] = readings
        return ideal[:, self.taxels]

    @property
    def outlined(self) -> tuple[str, ...]:
        """Name the letters that have an outline alone, and no relief."""
        return tuple(name for name in self._recorded.letters if self._letters[name].relief is None)

    @property
    def outline(self) -> NDArray[np.intp]:
        """Number the outline of each press, (n,), as in `outlined`; -1 if it has none alone."""
        number = {name: index for index, name in enumerate(self.outlined)}
        return np.array([number.get(label, -1) for label in self._recorded.labels.tolist()])

    def _press(self, errors: FloatArray, options: ScanOptions, guess: Guess) -> dict[str, Pressed]:
        """Press every letter; once for all point spreads with the same cells: these change only what taxels feel."""
        lines = b" ".join(edges.tobytes() for edges in options.cell_lines)
        wanted = errors.tobytes(), guess.stiffness, guess.wrist, lines, guess.grown
        if self._pressed is None or self._pressed[0] != wanted:
            poses = compose(self._recorded.poses, errors[:, :3])
            labels = self._recorded.labels
            grown = zip(self.outlined, guess.grown, strict=False)
            letters = self._letters | {name: wider(self._letters[name], by) for name, by in grown if by}
            pressed = {}
            for name in self._recorded.letters:
                own = labels == name
                pressed[name] = press_at(Touches(letters[name], poses[own], errors[own, 3:]), options)
            self._pressed = wanted, pressed
        return self._pressed[1]


def check_presses(recorded: Scan, predicted: FloatArray) -> None:
    """Refuse recorded presses that cannot be those of the simulation, with predicted (n, taxels) kPa at their poses.

    Raises InputError for readings that are not 0 at rest, idle frames where the simulation touches, a press that
    resembles nothing of what it presses there, and a press that two labels have in common. Presses that only graze an
    object are not judged.
    """
    felt = np.clip(find_idle(recorded.readings, recorded.presses).rise(recorded.readings), 0, None)
    predicted = np.nan_to_num(predicted)
    touch, most = predicted.max(axis=1), felt.max(axis=1)
    rest = recorded.readings[untouched(predicted) & (touch > 0)[:, None]]
    if len(rest) and abs(level := float(np.median(rest))) > _IDLE * np.ptp(recorded.readings):
        raise InputError(
            f"taxels that nothing touches in the simulation read {level:.4g} in the recording, not 0; import or replay "
            f"it with --zero {level:.4g}, or with --idle"
        )
    judged = touch > _GRAZES * (np.median(touch[touch > 0]) if touch.any() else 0.0)
    idle = judged & (most <= _IDLE * (np.median(most[judged]) if judged.any() else 0.0))
    size = np.linalg.norm(felt, axis=1) * np.linalg.norm(predicted, axis=1)
    lost = judged & ~idle & ((felt * predicted).sum(axis=1) < _FITS * size)
    nothing = "are idle frames, which feel next to nothing where the simulation touches: {}; leave them out"
    refuse_presses(recorded, idle, "presses", nothing)
    nowhere = "fit nowhere on what is pressed at their poses: {}; are poses and labels right?"
    refuse_presses(recorded, lost, "presses", nowhere)
    check_labels_apart(recorded, judged)


def wider(letter: Letter, by: float) -> Letter:
    """Move a letter's outline outwards by `by` mm, or inwards; by half of it, and so on, where little would be left."""
    from manifold3d import JoinType

    area = letter.footprint.area()
    while (moved := letter.footprint.offset(by, JoinType.Miter)).area() < _LEAST_AREA * area:
        by /= 2
    return replace(letter, contours=tuple(np.asarray(contour) for contour in moved.to_polygons()))
