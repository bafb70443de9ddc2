"""The pad's imperfections: a list of effects, each a class with its options, what it draws and what it does.

Whoever senses, bounds, tests or lists what a pad does walks `EFFECTS`. So a new effect is one class here, its name
among the bases of `SensorOptions`, and its row on docs/sensor.md.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import BeforeValidator, Field, field_validator

from tactsim.core.checking import Settings
from tactsim.core.poses import FloatArray
from tactsim.core.seeds import stream

if TYPE_CHECKING:
    from tactsim.press.scan_options import ScanOptions

Share = Annotated[float, Field(ge=0, le=1)]
_DEVIATIONS = 100  # of noise, past which no reading lies
_TEXTURES = 10  # the same of the texture


@dataclass
class Frames:
    """What effects know of the readings that they are applied to: s sequences of n readings each.

    gain: (taxels,), of `gains`; (s, touches, taxels) where touches have a texture. rows: of the pad; where it is None
    there may be no effect that needs it. number: (s, n), which reading of its touches each is, from 1: the zero
    drifts from one to the next. one_touch: whether a sequence is the images of one touch, which have hysteresis,
    instead of one reading of each touch after another, between which there is lag. before: (s, taxels) kPa, what was
    felt at the last touch, NaN where there was none; then at the last of these.
    """

    gain: FloatArray
    rows: int | None
    number: NDArray[np.intp]
    one_touch: bool = False
    before: FloatArray = field(default_factory=lambda: np.full((1, 1), np.nan))

    @property
    def touches(self) -> int:
        """Say how many touches a sequence has."""
        return 1 if self.one_touch else self.number.shape[1]

    def matrix(self, values: FloatArray) -> FloatArray:
        """Lay values (..., taxels) out as (m, rows, columns). Raises ValueError where the pad's rows are not given."""
        if self.rows is None:
            raise ValueError("effects of rows and ghosting need the pad's number of rows")
        return values.reshape(-1, self.rows, values.shape[-1] // self.rows)


class Facts(NamedTuple):
    """What is true of an effect.

    name: the option that switches it. off: that option's value without the effect. draws: random numbers that are
    always drawn come before those that are drawn where an effect is on, so that switching one changes no other draw
    of the first kind, and of the second none before it. of_touch: whether it is drawn once for all images of a
    touch. remembers: whether what is read depends on the readings before.

    What a bound may say of it: learned: training readings tell it, so it counts with what is pressed. gaussian: whether
    a reading stays normal about what is pressed. mixes: what it mixes, and then there is no bound.
    """

    name: str
    off: object = 0
    draws: Literal["never", "always", "where on"] = "never"
    of_touch: bool = False
    remembers: bool = False
    learned: bool = False
    gaussian: bool = False
    mixes: str = ""


class Effect(Settings):
    """An imperfection of the pad; its fields are its options."""

    facts: ClassVar[Facts]

    @classmethod
    def acts(cls, options: SensorOptions) -> bool:
        """Tell whether it changes readings."""
        return bool(getattr(options, cls.facts.name) != cls.facts.off)

    def draw(self, at: Frames, rng: np.random.Generator) -> FloatArray:
        """Draw for one of the sequences."""
        raise NotImplementedError

    def apply(self, readings: FloatArray, drawn: FloatArray, at: Frames) -> FloatArray:
        """Change readings (s, n, taxels) kPa, which stay as they are. drawn: (s, ...), of `draw`, or (0,)."""
        raise NotImplementedError

    def most(self, high: FloatArray, at: Frames) -> FloatArray:
        """Say how much taxels (taxels,) read at most, kPa, of what is `high` without it."""
        return high

    def variance(self) -> float:
        """Give the variance that it adds to a taxel's reading, kPa^2."""
        return 0.0

    def kept(self) -> float:
        """Give the share of readings that still tell of the press."""
        return 1.0


class PointSpread(Settings):
    """The layer's: `spread` applies it to the pressure, before there are taxels."""

    psf_sigma: float = Field(
        1.0, ge=0, le=10, description="mm, standard deviation of the point spread (assumed)"
    )

    @field_validator("psf_sigma")
    @classmethod
    def _sharp_or_smooth(cls, sigma: float) -> float:
        if 0 < sigma < 0.3:
            raise ValueError("a point spread below 0.3 mm is finer than the bed's cells; give 0 for none")
        return sigma


class Hysteresis(Effect):
    """A load that falls is read too high; images of one touch show it."""

    facts = Facts("hysteresis", remembers=True, gaussian=True)
    hysteresis: float = Field(
        0.0,
        ge=0,
        le=0.25,
        description="share of a touch's peak by which a falling load is read too high at most (assumed)",
    )

    def apply(self, readings: FloatArray, drawn: FloatArray, at: Frames) -> FloatArray:
        """Let images depend on how they came about."""
        if not at.one_touch:
            return readings
        from tactsim.press.dynamics import hysteretic  # which presses through time, as such images are made

        return np.stack([hysteretic(some, self.hysteresis) for some in readings])


class Texture(Effect):
    """What the contact of each press does to the gains: neither pad nor object is flat.

    Where their unevenness adds up to a gap nothing is felt, so no gain is below 0.
    """

    facts = Facts("texture", draws="where on", of_touch=True)
    texture: float = Field(
        0.0,
        ge=0,
        le=3,
        exclude_if=lambda spread: spread == 0,
        description="standard deviation of what the contact of a press adds to each taxel's gain (assumed even)",
    )

    def draw(self, at: Frames, rng: np.random.Generator) -> FloatArray:
        """Draw for each touch and taxel."""
        return rng.standard_normal((at.touches, at.gain.shape[-1]))

    def apply(self, readings: FloatArray, drawn: FloatArray, at: Frames) -> FloatArray:
        """Change the gains, with which `GainSpread` multiplies."""
        at.gain = np.maximum(at.gain + self.texture * drawn, 0)
        return readings

    def most(self, high: FloatArray, at: Frames) -> FloatArray:
        """Say how much taxels read at most."""
        at.gain = at.gain + _TEXTURES * self.texture
        return high


class GainSpread(Effect):
    """Each taxel's gain: one set for each pad, of `gains`."""

    facts = Facts("gain_spread", learned=True)
    gain_spread: float = Field(
        0.0, ge=0, le=1, description="standard deviation of the taxels' relative gains (assumed)"
    )

    @classmethod
    def acts(cls, options: SensorOptions) -> bool:
        """Tell whether any gain is not 1, which a texture does too."""
        return bool(options.gain_spread or options.texture)

    def apply(self, readings: FloatArray, drawn: FloatArray, at: Frames) -> FloatArray:
        """Multiply with the gains."""
        return at.gain * readings

    def most(self, high: FloatArray, at: Frames) -> FloatArray:
        """Say how much taxels read at most."""
        return at.gain * high


class Response(Effect):
    """A bent response: a power of the pressure."""

    facts = Facts("response", off=1, learned=True)
    response: float = Field(
        1.0,
        ge=0.2,
        le=5,
        description="exponent g of the response curve p0 (p / p0)^g, with p0 = response_pressure; 1: linear (assumed)",
    )
    response_pressure: float = Field(
        25.0, ge=1e-3, le=1e6, description="kPa, p0: the pressure that a bent response reads right (assumed)"
    )

    def apply(self, readings: FloatArray, drawn: FloatArray, at: Frames) -> FloatArray:
        """Bend the readings."""
        right = self.response_pressure
        bent: FloatArray = right * (np.maximum(readings, 0) / right) ** self.response
        return bent

    def most(self, high: FloatArray, at: Frames) -> FloatArray:
        """Say how much taxels read at most."""
        return Response.apply(self, high, high, at)


class Lag(Effect):
    """A share of what was felt at the touch before is still felt."""

    facts = Facts("lag", remembers=True, mixes="two readings")
    lag: float = Field(
        0.0, ge=0, lt=1, description="share of the previous touch's reading that is still felt (assumed)"
    )

    def apply(self, readings: FloatArray, drawn: FloatArray, at: Frames) -> FloatArray:
        """Mix each reading with the one before, of another touch."""
        if at.one_touch:
            return readings
        felt = readings.copy()
        before = at.before
        for now in felt.swapaxes(0, 1):
            now += np.where(np.isnan(before), 0.0, self.lag * (before - now))
            before = now
        at.before = before.copy()
        return felt


class Ghosting(Effect):
    """Cross-talk of a resistive matrix without guards (docs/sensor.md, "Resistive matrices")."""

    facts = Facts("ghosting", off="none", mixes="the taxels")
    ghosting: Literal["none", "floating"] = Field(
        "none",
        description="cross-talk of a resistive matrix without guards: wires that are not read hang free (assumed none)",
    )
    leakage: float = Field(
        2.0,
        ge=1e-3,
        le=1e6,
        description="kPa that would let a cell conduct as much as it does unpressed; with ghosting (assumed)",
    )

    def apply(self, readings: FloatArray, drawn: FloatArray, at: Frames) -> FloatArray:
        """Read the taxels as such a matrix does, above what it reads at rest."""
        from tactsim.core.matrix import mixed, of_uniform

        cells = at.matrix(np.maximum(readings, 0) + self.leakage)
        ghosts: FloatArray = mixed(cells).reshape(readings.shape) - of_uniform(self.leakage, *cells.shape[1:])
        return ghosts

    def most(self, high: FloatArray, at: Frames) -> FloatArray:
        """Say how much taxels read at most: no more than where all conduct as the best one does."""
        from tactsim.core.matrix import of_uniform

        rows, columns = at.matrix(high).shape[1:]
        return np.full_like(high, of_uniform(float(high.max()) + self.leakage, rows, columns))


class Drift(Effect):
    """The zero moves from one reading to the next."""

    facts = Facts("drift", remembers=True)
    drift: float = Field(
        0.0, ge=-100, le=100, description="kPa that the zero moves from one reading to the next (assumed)"
    )

    def apply(self, readings: FloatArray, drawn: FloatArray, at: Frames) -> FloatArray:
        """Add it once more with every reading."""
        return readings + self.drift * at.number[..., None]

    def most(self, high: FloatArray, at: Frames) -> FloatArray:
        """Say how much taxels read at most within 100 readings."""
        return high + 100 * self.drift


class Noise(Effect):
    """White noise."""

    facts = Facts("noise", draws="always", gaussian=True)
    noise: float = Field(2.0, ge=0, le=1e6, description="kPa, standard deviation of white noise (assumed)")

    def draw(self, at: Frames, rng: np.random.Generator) -> FloatArray:
        """Draw for each reading and taxel."""
        return rng.standard_normal((at.number.shape[1], at.gain.shape[-1]))

    def apply(self, readings: FloatArray, drawn: FloatArray, at: Frames) -> FloatArray:
        """Add it."""
        return readings + self.noise * drawn

    def most(self, high: FloatArray, at: Frames) -> FloatArray:
        """Say how much taxels read at most."""
        return high + _DEVIATIONS * self.noise

    def variance(self) -> float:
        """Give its variance."""
        return self.noise**2


class RandomTaxels(Effect):
    """Some taxels read anything."""

    facts = Facts("random_taxels", draws="always")
    random_taxels: Share = Field(
        0.0, description="probability that a taxel's reading is replaced by a random one (assumed)"
    )

    def draw(self, at: Frames, rng: np.random.Generator) -> FloatArray:
        """Draw whether a taxel reads something random, and how much of the largest: uniform."""
        return rng.random((2, at.number.shape[1], at.gain.shape[-1]))

    def apply(self, readings: FloatArray, drawn: FloatArray, at: Frames) -> FloatArray:
        """Replace by values even between 0 and 0.6 of the largest, so that eq. 3 calls half of them In Contact."""
        largest = np.maximum(readings.max(axis=-1, keepdims=True), 0)
        return np.where(drawn[:, 0] < self.random_taxels, 0.6 * largest * drawn[:, 1], readings)

    def kept(self) -> float:
        """Give the share of taxels that tell of the press."""
        return 1 - self.random_taxels


class Saturation(Effect):
    """A taxel stops rising."""

    facts = Facts("saturation", off=None)
    saturation: float | None = Field(
        None, gt=0, description="kPa at which a taxel stops rising, None for never (assumed)"
    )

    def apply(self, readings: FloatArray, drawn: FloatArray, at: Frames) -> FloatArray:
        """Cut the readings off."""
        return np.minimum(readings, self.saturation or np.inf)

    def most(self, high: FloatArray, at: Frames) -> FloatArray:
        """Say how much taxels read at most."""
        return np.full_like(high, self.saturation or np.inf)


class Resolution(Effect):
    """Readings are whole steps."""

    facts = Facts("resolution", gaussian=True)
    resolution: float = Field(
        0.7, ge=0, le=1000, description="kPa, the smallest step of a reading (published)"
    )

    @field_validator("resolution")
    @classmethod
    def _countable_steps(cls, step: float) -> float:
        if 0 < step < 1e-6:
            raise ValueError("steps below 1e-6 kPa are finer than a reading's digits; give 0 for none")
        return step

    def apply(self, readings: FloatArray, drawn: FloatArray, at: Frames) -> FloatArray:
        """Round."""
        return np.round(readings / self.resolution) * self.resolution

    def variance(self) -> float:
        """Give the variance of a place within a step."""
        return self.resolution**2 / 12


class Unmix(Ghosting):
    """The driver's own undoing of ghosting."""

    facts = Facts("unmix", off=False)
    unmix: bool = Field(
        True,
        description="whether ghosting is taken out of the readings again, as a device file's [matrix] has it done",
    )

    @classmethod
    def acts(cls, options: SensorOptions) -> bool:
        """Tell whether there is something to undo."""
        return options.unmix and Ghosting.acts(options)

    def apply(self, readings: FloatArray, drawn: FloatArray, at: Frames) -> FloatArray:
        """Take the ghosts out again: none is below 0 then."""
        from tactsim.core.matrix import of_uniform, unmixed

        cells = at.matrix(readings)
        cells = cells + of_uniform(self.leakage, *cells.shape[1:])
        return unmixed(cells, self.leakage).reshape(readings.shape) - self.leakage

    def most(self, high: FloatArray, at: Frames) -> FloatArray:
        """Say that this makes nothing higher."""
        return high


class DeadTaxels(Effect):
    """Some taxels are dead."""

    facts = Facts("dead_taxels", off=(), learned=True)
    dead_taxels: Annotated[
        tuple[Annotated[int, Field(ge=0)], ...],
        BeforeValidator(lambda words: words.replace(",", " ").split() if isinstance(words, str) else words),
    ] = Field((), description="taxels that read 0, like 3,47")

    def apply(self, readings: FloatArray, drawn: FloatArray, at: Frames) -> FloatArray:
        """Read 0 there."""
        readings = readings.copy()
        readings[..., list(self.dead_taxels)] = 0.0
        return readings

    def check_dead_taxels(self, taxels: int) -> None:
        """Raise ValueError if one of them is none of a pad's so many taxels."""
        for taxel in self.dead_taxels:
            if taxel >= taxels:
                raise ValueError(f"dead taxel {taxel} does not exist: the pad's taxels are 0 to {taxels - 1}")


class RowDropout(Effect):
    """A row of the pad has no contact while it is touched, as where a flat cable sits loosely in its connector."""

    facts = Facts("row_dropout", draws="where on", of_touch=True)
    row_dropout: Share = Field(
        0.0,
        exclude_if=lambda share: share == 0,
        description="probability that a row of the pad reads 0 for a touch (assumed)",
    )

    def draw(self, at: Frames, rng: np.random.Generator) -> FloatArray:
        """Draw for each touch and row."""
        return rng.random((at.touches, at.matrix(at.gain).shape[1]))

    def apply(self, readings: FloatArray, drawn: FloatArray, at: Frames) -> FloatArray:
        """Read 0 there."""
        lost = np.repeat(drawn < self.row_dropout, readings.shape[-1] // drawn.shape[-1], axis=-1)
        return np.where(lost, 0.0, readings)

    def kept(self) -> float:
        """Give the share of rows that tell of the press."""
        return 1 - self.row_dropout


# The bases are listed from the last effect to the first: so the options stand in the effects' order.
class SensorOptions(
    RowDropout, DeadTaxels, Unmix, Resolution, Saturation, RandomTaxels, Noise, Drift, Ghosting, Lag, Response,
    GainSpread, Texture, Hysteresis, PointSpread,
):  # fmt: skip
    """How the pad turns contact pressure into readings. 0, None or () switches an effect off.

    An option that came later than the frozen tasks is not written down while it is off, so that what is hashed of
    older options stays as it was.
    """

    def without(self, effects: Iterable[type[Effect]]) -> SensorOptions:
        """Switch some effects off."""
        return self.model_copy(update={effect.facts.name: effect.facts.off for effect in effects})


# In the order in which they are applied, which is that of docs/sensor.md.
EFFECTS: tuple[type[Effect], ...] = tuple(
    base for base in reversed(SensorOptions.__bases__) if issubclass(base, Effect)
)


def sense(
    ideal: FloatArray,
    options: SensorOptions,
    gain: FloatArray,
    rng: np.random.Generator,
    *,
    rows: int | None = None,
    one_touch: bool = False,
) -> FloatArray:
    """Turn a sequence of ideal readings into what the pad reports: (readings, taxels) kPa.

    ideal: (readings, taxels) kPa, in the order in which they are taken. gain: (taxels,), of `gains`.
    rows: of the pad, which only ghosting and rows that drop out need to know. one_touch: as in `Frames`.
    Readings may be below zero, as a tared sensor's are.
    """
    at = Frames(gain, rows, np.arange(1, len(ideal) + 1)[None], one_touch)
    return take(ideal[None], options, at, [rng])[0]


def take(
    ideal: FloatArray,
    options: SensorOptions,
    at: Frames,
    rngs: Sequence[np.random.Generator],
    effects: Sequence[type[Effect]] = EFFECTS,
) -> FloatArray:
    """Turn sequences of ideal readings (s, n, taxels) kPa into what the pad reports, by some of its effects in order.

    rngs: s, of each sequence. at: is changed, as `Frames` says.
    """
    drawing = [effect for effect in effects if effect.facts.draws == "always"]
    drawing += [effect for effect in effects if effect.facts.draws == "where on" and effect.acts(options)]
    every = [[effect.draw(options, at, rng) for effect in drawing] for rng in rngs]
    drawn = {effect: np.stack(some) for effect, some in zip(drawing, zip(*every, strict=True), strict=True)}
    readings = ideal
    for effect in effects:
        if effect.acts(options):
            readings = effect.apply(options, readings, drawn.get(effect, np.empty(0)), at)
    return readings


def gains(options: ScanOptions) -> FloatArray:
    """Draw the taxels' gains, (taxels,), normal about 1 and not below 0: the same pad for the same seed."""
    rng = stream(options.seed, "pad", "gain")
    return np.maximum(1 + options.sensor.gain_spread * rng.standard_normal(options.pad.taxels), 0)
