"""The forward model of an estimator: what the simulated pad would read of a letter, and how that changes.

It is the press of `exact` and `balance` for flat faces on springs. `exact` balances in the same closed form, and
`balance` has MuJoCo do it; both spread the pressure cell by cell, while here it is an integral along the border of what
touches. So a press takes some 20 us, derivatives included: with finer cells the others come nearer to this.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from tactsim.core.checking import checked
from tactsim.core.errors import InputError, unknown
from tactsim.core.forward import Linearised
from tactsim.core.poses import FloatArray, compose
from tactsim.core.provenance import had_another_shape
from tactsim.core.scan import Scan
from tactsim.models import Letter, names, shape
from tactsim.press.engine import engine_for
from tactsim.press.exact import outline, springs
from tactsim.press.scan_options import ScanOptions
from tactsim.press.scanning import letters_of
from tactsim.press.spread import felt_along
from tactsim.press.touches import Touches, log_spread

# of the tables of what a taxel feels; linear between them, which costs 5e-5 of a pressure
_NODES_PER_SIGMA = 50
# of the load spread evenly over the pad: of a pad without noise nobody could begin to search
_LEAST_NOISE = 0.01
_MOTIONS = 3  # of the derivatives, the first three are the sensor's own motions


def check_flat(letter: Letter, options: ScanOptions) -> None:
    """Raise InputError unless the forward model can press the letter: a flat face on springs, at rest."""
    engine = engine_for(Touches.of(letter, np.zeros((1, 3))), options)
    if options.press.dynamics == "full" or letter.rounding or engine not in ("exact", "bed"):
        raise InputError(
            f"the forward model presses flat faces with sharp edges on springs, at rest; {letter.name!r} is pressed "
            f"otherwise here"
        )


class PressModel:
    """Predict readings by pressing: a `tactsim.core.forward.ForwardModel`.

    letters: what can be pressed. options: pad, press and sensor, and how far presses are off. taxel: (taxels,)
    which of the pad's taxels are read, all by default.

    Raises InputError for a press that is no flat face on springs at rest.
    """

    def __init__(
        self, letters: Sequence[Letter], options: ScanOptions, taxel: NDArray[np.intp] | None = None
    ) -> None:
        for letter in letters:
            check_flat(letter, options)
        pad, press, sensor = options.pad, options.press, options.sensor
        if sensor.ghosting != "none" and not sensor.unmix:
            raise InputError("the forward model knows no ghosting; give sensor.unmix = true")
        self.letters = tuple(letter.name for letter in letters)
        self._taxel = taxel
        self.taxels = pad.taxels if taxel is None else len(taxel)
        self._outlines = {letter.name: outline(letter) for letter in letters}
        self._bounds = np.array(pad.load_bounds)
        self._springs = springs(press)
        self._tilt = np.array([press.tilt_x, press.tilt_y])
        low_x, high_x, low_y, high_y = self._bounds.tolist()
        self._felt_x, first_x, gap = _felt(low_x, high_x, pad.column_edges.tobytes(), sensor.psf_sigma)
        felt_y, first_y, _ = _felt(low_y, high_y, pad.row_edges.tobytes(), sensor.psf_sigma)
        self._felt_y = np.ascontiguousarray(felt_y[:, :1])
        self._table = np.array([first_x, first_y, gap])
        # A step of the reading adds the variance of what is rounded off. No prediction is better than to first order.
        noise = math.hypot(sensor.noise, sensor.resolution / math.sqrt(12))
        width, height = self._bounds[1] - self._bounds[0], self._bounds[3] - self._bounds[2]
        self.noise = max(noise, _LEAST_NOISE * 1e3 * press.force / (width * height))
        self.placement = np.array([options.placement_mm, options.placement_mm, options.placement_rad])
        tilt = options.placement_tilt
        self._spread = np.array([tilt, tilt, log_spread(options.load_spread)])
        self._response, self._response_pressure = sensor.response, sensor.response_pressure
        # Beyond this distance of the pad's middle from the letter's nothing touches.
        corner = math.hypot(*np.abs(self._bounds).reshape(2, 2).max(axis=1))
        self.reach: Mapping[str, float] = {
            letter.name: corner + float(np.hypot(*np.concatenate(letter.contours).T).max())
            for letter in letters
        }
        self.symmetry: Mapping[str, int] = {
            letter.name: 0 if math.isinf(letter.symmetry) else int(letter.symmetry) for letter in letters
        }
        flipped = np.allclose(pad.taxel_xy[::-1], -pad.taxel_xy) and np.allclose(
            self._bounds, -self._bounds[[1, 0, 3, 2]]
        )
        self.turns = 2 if flipped and taxel is None and not self._tilt.any() else 1

    def readings(
        self, letter: str, sensor_in_object: FloatArray, tilts: FloatArray | None = None
    ) -> FloatArray:
        """Predict readings (n, taxels) kPa without imperfections; tilts: (n, 2) rad beside the press's own."""
        return self._pressed(letter, sensor_in_object, tilts, derive=False)[0]

    def linearised(
        self,
        letter: str,
        sensor_in_object: FloatArray,
        off: FloatArray | None = None,
        load: FloatArray | None = None,
    ) -> Linearised:
        """Predict readings and their derivatives, as `ForwardModel.linearised` says.

        Loads are log-normal with mean 1, as `draw_loads` draws them.
        """
        own = np.flatnonzero(self._spread)
        off = np.zeros((len(sensor_in_object), _MOTIONS + len(own))) if off is None else off
        place = off[:, :_MOTIONS] * self.placement
        spread = np.zeros((len(off), 3))
        spread[:, own] = off[:, _MOTIONS:] * self._spread[own]
        own_load = np.exp(spread[:, 2] - self._spread[2] ** 2 / 2) * (1.0 if load is None else load)
        mean, by = self._pressed(
            letter, compose(sensor_in_object, place), spread[:, :2], own_load, derive=True
        )
        by_pose = _by_stated(by[:, :_MOTIONS], place)
        by_place = by_pose.copy()
        by_place[:, 2] = by[:, 2]  # the pad errs by turning about its own middle
        nuisance = [by_place * self.placement[:, None], by[:, _MOTIONS + own] * self._spread[own, None]]
        if load is not None:
            nuisance.append(by[:, -1:])
        return Linearised(mean, by_pose, np.concatenate(nuisance, axis=1))

    def _pressed(
        self,
        letter: str,
        poses: FloatArray,
        tilts: FloatArray | None,
        load: FloatArray | None = None,
        *,
        derive: bool,
    ) -> tuple[FloatArray, FloatArray]:
        """Press at poses (n, 3), with tilts (n, 2) rad beside the press's own and loads (n,) in shares of its force.

        On springs everything is proportional: c times the load and c times the tilts give c times the pressures.
        """
        # Brings compiled loops, which a model that never presses does without.
        from tactsim.press.forward_kernels import Felt, Layer, Outline, press_all

        if letter not in self._outlines:
            raise unknown("letter of the forward model", letter, self.letters)
        poses = np.array(poses, dtype=float, order="C")  # the compiled loops take no read-only array
        tilted = np.tile(self._tilt, (len(poses), 1)) if tilts is None else tilts + self._tilt
        if load is not None:
            tilted /= load[:, None]
        taxels = self._felt_x.shape[2] * self._felt_y.shape[2]
        mean = np.empty((len(poses), taxels))
        by = np.empty((len(poses), 6, taxels))
        press_all(
            Outline(*self._outlines[letter]), poses, tilted, Layer(self._bounds, self._springs),
            Felt(self._felt_x, self._felt_y, self._table), int(derive), mean, by,
        )  # fmt: skip
        if load is not None:
            mean *= load[:, None]
            by *= load[:, None, None]
            by[:, _MOTIONS : _MOTIONS + 2] /= load[:, None, None]
        if self._response != 1:  # the sensor's response curve, as `sensor.sense` bends it
            relative = np.maximum(mean, 1e-3) / self._response_pressure
            by *= (self._response * relative ** (self._response - 1))[:, None]
            mean = self._response_pressure * relative**self._response
        if self._taxel is None:
            return mean, by
        return np.ascontiguousarray(mean[:, self._taxel]), np.ascontiguousarray(by[:, :, self._taxel])


def forward_model(scan: Scan, options: ScanOptions | None = None) -> PressModel:
    """Make the forward model of a scan: its letters, pressed as `options` say, or else as the scan says that they were.

    Raises InputError if neither says how, if a letter is not known or has changed since, or for a press that is no flat
    face on springs at rest.
    """
    told = options is not None
    if options is not None:  # which name shapes; other labels are letters of the catalogue
        drawn = {shape(path).name for path in options.shapes}
        options = options.model_copy(
            update={"letters": tuple(name for name in scan.letters if name not in drawn and name in names())}
        )
    else:
        stated = scan.meta.get("options")
        if not isinstance(stated, Mapping):
            raise InputError(
                "the scan does not say how its letters were pressed (meta.options): say it, with --shape FILE for each "
                "shape and --pad FILE"
            )
        options = checked(ScanOptions, stated, "scan: meta.options")
    letters = {letter.name: letter for letter in letters_of(options)}
    for label in scan.letters:
        if label not in letters:
            if told:
                raise InputError(f"no --shape is called {label!r}, and no letter of the catalogue either")
            raise unknown("letter of the scan's meta.options", label, letters)
        if not told and had_another_shape(scan.meta, label, letters[label].digest):
            raise InputError(f"{label!r} has another shape now than when the scan was made; scan again")
    apart = np.abs(scan.taxel_xy[:, None] - options.pad.taxel_xy[None]).max(axis=-1)
    taxel = apart.argmin(axis=1)
    if (apart.min(axis=1) > 1e-3).any():
        raise InputError(
            "the scan's taxels lie elsewhere than its pad's (meta.options, or --pad), so none can be pressed"
        )
    whole = np.array_equal(taxel, np.arange(options.pad.taxels))
    return PressModel([letters[label] for label in scan.letters], options, None if whole else taxel)


def _by_stated(by_own: FloatArray, place: FloatArray) -> FloatArray:
    """Turn derivatives by motions of the pad where it is (n, 3, taxels) into those by motions of where it was stated.

    place: (n, 3) the pad's pose in the stated one. A turn about the stated middle carries the pad along.
    """
    (x, y, turn) = place.T[:, :, None]
    cos, sin = np.cos(turn), np.sin(turn)
    by_x, by_y = cos * by_own[:, 0] - sin * by_own[:, 1], sin * by_own[:, 0] + cos * by_own[:, 1]
    return np.stack([by_x, by_y, by_own[:, 2] - y * by_x + x * by_y], axis=1)


@lru_cache(maxsize=8)
def _felt(low: float, high: float, edges: bytes, sigma: float) -> tuple[FloatArray, float, float]:
    """Tabulate what each taxel along one axis feels of a unit force, and the integrals of that and of x times it.

    low, high: mm, the pad's bounds along the axis. edges: the bytes of (taxels, 2) mm. Returns (n, 3, taxels), in 1/mm,
    1 and mm, at nodes equally far apart, with the place of the first node and their distance, mm. The tables are kept:
    many models of one pad are made, one for each load or letter.
    """
    gap = max(sigma, 0.3) / _NODES_PER_SIGMA
    nodes = np.arange(low - gap, high + 2 * gap, gap)
    edge = np.frombuffer(edges).reshape(-1, 2)
    points, weights = np.polynomial.legendre.leggauss(4)
    step = nodes[1] - nodes[0]
    inside = (nodes[:-1, None] + step / 2) + step / 2 * points
    felt = felt_along(inside, edge, sigma) / (edge[:, 1] - edge[:, 0])
    pieces = np.stack(
        [np.einsum("p,npt->nt", weights, felt), np.einsum("p,np,npt->nt", weights, inside, felt)], axis=1
    )
    sums = np.concatenate([np.zeros((1, 2, len(edge))), np.cumsum(pieces * step / 2, axis=0)])
    at_nodes = felt_along(nodes, edge, sigma) / (edge[:, 1] - edge[:, 0])
    return np.concatenate([at_nodes[:, None], sums], axis=1), float(nodes[0]), gap
