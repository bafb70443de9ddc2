"""What taxels read that nothing touches, and whether more load reads more: found from the readings of many presses.

Raw counts have a baseline, each taxel its own, and with some pads they fall under load. At rest a taxel reads the same
again and again, at one end of its range; under load it reads this and that. So the end at which a tenth of its readings
lie closer together is the idle one, and the mean of the shortest interval with half of the readings at that end (the
shorth, Andrews et al. 1972) is the idle level.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactsim.core.errors import InputError, short
from tactsim.core.finite import finite
from tactsim.core.poses import FloatArray

if TYPE_CHECKING:
    from tactsim.core.scan import Scan

_FEWEST = 50  # presses
_FAILED = 3  # presses with one and the same reading
_TAILS = (0.01, 0.99)  # quantiles between which a taxel's range lies
_SHARED = 0.1  # the least share of a taxel's readings at its idle level
_EQUAL = 1e-9  # of a taxel's range: distances that differ by less are equal, whatever rounding made of them
_FELT = 0.1  # of the range of most taxels: one with less was hardly ever loaded, and has no say
_NARROW = 0.05  # of its range: readings at an end of it that lie closer together are at rest, or saturated
_QUIET = 4.0  # times as far apart as those of most taxels readings at rest may lie
_FEW = 0.2  # of the taxels: so many may be judged wrongly where a pad is pressed at a few places
_MOST = 0.5  # of the taxels: so many do not fail often
# Numbers that devices and programs write for what they could not measure: ends of 16 and 24 bits, and nines.
_NO_READING = {
    end for bits in (16, 24) for end in (-(2.0 ** (bits - 1)), 2.0 ** (bits - 1) - 1, 2.0**bits - 1)
}
_NO_READING |= {sign * (10.0**digits - 1) for sign in (-1, 1) for digits in range(3, 10)}
_OVER = 16  # times as wide as beyond the end of 16 bits is the gap between counts that left them, and others
SELDOM = 0.05  # the most of its cells that fail where a taxel does not
_MARKS = 4  # kinds of numbers for what was not measured that a pad may show within its range
_MANY = 3  # cells that read one and the same number
_FILLED = 20.0  # so many readings are missing beside those that would saturate
_DRIFTS = 0.1  # of the typical rise
_OFF = 0.05  # of the typical rise: idle levels this far from 0 are not those of tared readings
_END = 0.05  # of the range of most taxels: a level no further than this from the end of its taxel's range is at it
_PARTS = 3  # of a file, at least, whose levels are compared
_BLOCK = 25  # presses, one after the other, within which a zero that drifts stays about where it is
_HELD = 0.5  # of the presses: a taxel that is at the end of its range in fewer is seldom at rest
_MOVED = 0.3  # of the range of most taxels: no zero drifts further
_LOUD = 0.1  # of the range of most taxels: readings that lie further apart are no noise
_OF_NOISE = 1.7  # of Gaussian noise the lowest hundredth begins so many shorths below the middle


@dataclass(frozen=True, eq=False)
class Idle:
    """What idle taxels read. level: (taxels,) in the readings' unit. sign: (taxels,) 1, or -1 where readings fall
    under load. known: (taxels,) whether the level could be told. typical: the median rise of loaded taxels.
    repeated: how many readings came again to the digit in other presses, and had no say.
    """

    level: FloatArray
    sign: FloatArray
    known: NDArray[np.bool_]
    typical: float
    repeated: int = 0

    def rise(self, readings: ArrayLike) -> FloatArray:
        """Give how far readings (..., taxels) are above the idle level, towards the load."""
        return np.asarray((np.asarray(readings, dtype=float) - self.level) * self.sign)

    def __eq__(self, other: object) -> bool:
        """Compare the arrays."""
        return isinstance(other, Idle) and all(
            np.array_equal(getattr(self, name), getattr(other, name)) for name in ("level", "sign", "known")
        )

    @property
    def off_zero(self) -> bool:
        """Tell whether more than a few taxels fall, or half of them rest clearly elsewhere than at 0."""
        return bool((self.sign < 0).mean() > _FEW or np.median(np.abs(self.level)) > _OFF * self.typical)

    def facts(self) -> dict[str, float | int]:
        """Say what was found as numbers, for a file: the median level, and how many taxels fall or are not known."""
        return {
            "idle_level": float(np.median(self.level)),
            "falling_taxels": int((self.sign < 0).sum()),
            "taxels_of_unknown_idle_level": int((~self.known).sum()),
        }

    def describe(self) -> str:
        """Say in a line what was found."""
        low, middle, high = np.quantile(self.level, (0, 0.5, 1))
        falling = int((self.sign < 0).sum())
        which = "falls" if falling == len(self.sign) else f"falls in {falling} taxels" if falling else "rises"
        unknown = int((~self.known).sum())
        doubt = f"; of {unknown} taxels it cannot be told from the readings" if unknown else ""
        again = f"; {self.repeated} readings that come again to the digit, as failed frames do, had no say"
        doubt += again if self.repeated else ""
        return f"idle level {middle:.4g} ({low:.4g} to {high:.4g}), and under load it {which}{doubt}"


def failed_cells(readings: ArrayLike) -> NDArray[np.bool_]:
    """Tell which cells of readings (n, taxels) failed: as 65535, 9999 or -9999, far from what all others read.

    A taxel that reads so in more than a twentieth of the presses is not judged; see `flickering`. Cells without a
    number (NaN) have no say.
    """
    marks = _apart(np.asarray(readings, dtype=float))
    return np.asarray(marks & (marks.mean(axis=0) <= SELDOM)) if marks.any() else marks


def flickering(readings: ArrayLike) -> NDArray[np.bool_]:
    """Tell which taxels of readings (n, taxels) fail in more than a twentieth of the presses.

    Raises InputError if most do.
    """
    values = np.asarray(readings, dtype=float)
    marks = _apart(values)
    often = marks.mean(axis=0) > SELDOM if marks.any() else np.zeros(marks.shape[1:], dtype=bool)
    if often.any() and often.mean() > _MOST:
        raise InputError(
            f"{marks.mean():.0%} of the cells read {short(float(values[marks][0]))}, far from all others, as failed "
            "cells do; leave out what was not measured, or write no number there"
        )
    return np.asarray(often)


def _apart(values: FloatArray) -> NDArray[np.bool_]:
    """Find numbers for what was not measured, further from what their taxel and the others read than these lie apart.

    Of the others the widest taxels, a twentieth and one at least, have no say: they may be broken. Of fifty presses or
    more also those that `_within_range` finds.
    """
    marks = np.isin(values, list(_NO_READING))
    while marks.any():  # what lies within the others is a reading, from the innermost on
        unread = marks | np.isnan(values)
        lows = np.where(unread, np.inf, values).min(axis=0)
        highs = np.where(unread, -np.inf, values).max(axis=0)
        said = np.flatnonzero(highs >= lows)
        said = said[np.argsort((highs - lows)[said], kind="stable")]
        said = said[: len(said) - max(1, len(said) // 20)] if len(said) > 2 else said
        if not len(said):
            return np.zeros(values.shape, dtype=bool)
        low, high = lows[said].min(), highs[said].max()
        beyond = np.maximum(values - np.maximum(highs, high), np.minimum(lows, low) - values)
        nearest = np.where(marks, beyond, np.inf).min()
        if nearest > high - low:
            break
        marks &= beyond > nearest
    for _ in range(_MARKS if len(values) >= _FEWEST else 0):
        found = _within_range(np.where(marks, np.nan, values))
        if not found.any():
            break
        marks |= found
    return marks


def _within_range(values: FloatArray) -> NDArray[np.bool_]:
    """Find numbers for what was not measured that a pad could read: one and the same, three times, where no other is.

    values: (n, taxels). At the end at which most taxels rest, those beyond what their own taxel reads at rest, 0 or -1
    once, too; at both ends, those so far beyond all others that readings which only saturate would have filled the gap.
    """
    found, count = np.zeros(values.shape, dtype=bool), (~np.isnan(values)).sum(axis=0)
    numbers, times = np.unique(values[~np.isnan(values)], return_counts=True)
    if len(numbers) < _FEWEST or not count.all():
        return found
    ends = []
    for sign in (1, -1):
        own = np.sort(sign * values, axis=0)  # NaN last
        again = (own == own[0]).sum(axis=0)
        at = np.minimum([again, again + np.ceil(_SHARED * count).astype(int)], count - 1)
        ends.append((own[0], again, *np.take_along_axis(own, at, axis=0)))
    extent = -ends[0][2] - ends[1][2]
    wide = _NARROW * np.quantile(extent, 0.9)
    widths = [np.median((far - near)[extent >= _FELT / _NARROW * wide]) for *_, near, far in ends]
    for sign, (first, again, near, far) in zip((1, -1), ends, strict=True):
        apart = (near - first > np.maximum(4 * (far - near), wide)) & (far - near <= wide)
        apart &= widths[0] * sign < widths[1] * sign
        for number in np.unique(first[apart]):
            cells, same = apart & (first == number), sign * values == number
            enough = number in (0, -1) or 2 * again[cells].sum() >= max(2 * _MANY, again[apart].sum())
            if enough and 4 * again[cells].sum() >= 3 * same.sum() and _are_few(same):
                found |= same & cells
        gap, often = abs(numbers[1] - numbers[0]), times[0]
        beside = numbers[1:][np.cumsum(times[1:]) <= often]
        filled = _FILLED * abs(beside[-1] - numbers[1]) if len(beside) else 0
        if often >= _MANY and often * gap > filled and 2 * gap > abs(numbers[-1] - numbers[1]):
            same = values == numbers[0]
            found |= same & _are_few(same)
        numbers, times = numbers[::-1], times[::-1]
    return found


def _are_few(cells: NDArray[np.bool_]) -> bool:
    """Tell whether cells (n, taxels) are seldom in most taxels."""
    return bool((cells.mean(axis=0) > SELDOM).mean() <= _MOST)


def unwrapped(readings: ArrayLike) -> tuple[FloatArray, int]:
    """Give readings (n, taxels) that left the range of their bits, 65530 for -6 or -32766 for 32770, as they were.

    Such are whole numbers of 8, 10, 12, 14, 16 or 24 bits, perhaps all times a constant, with a gap between, a half of
    the range, or an eighth where some are below 0 or few left it, and hardly one from the largest over the end of the
    range to the least; a taxel reads now below and now above it. One number alone may be that of failed cells, unless
    most taxels often read it and the others beside it. Returns how many left it.
    """
    values = np.array(readings, dtype=float)
    numbers = np.unique(values[~np.isnan(values)])
    unit = 1.0
    if (numbers % 1).any() and len(numbers) > 1:
        unit = float(f"{np.diff(numbers).min():.6g}")
        numbers = np.round(numbers / unit, 2)
    if len(numbers) < 2 or (numbers % 1).any() or np.ptp(numbers) >= 2**24:
        return values, 0
    if unit != 1:
        mended, count = unwrapped(np.round(values / unit))
        return (mended * unit, count) if count else (values, 0)
    signed, bits = numbers[0] < 0, _bits(numbers)
    widest = int(np.diff(numbers).argmax())
    low, high = numbers[widest : widest + 2]
    over = numbers[0] + 2**bits - numbers[-1]  # from the largest to the least, beyond the end of the range
    low_side, high_side = low - numbers[0], numbers[-1] - high
    few = 8 * high_side <= low_side  # what left the range, beside loads
    doubtful = bits < 16 and not few and 8 * low_side > high_side  # saturated, perhaps
    clear = 2 ** (bits - 3 if signed or few else bits - 1)
    if high - low <= clear or _OVER * over > high - low or (doubtful and not signed):
        return values, 0
    away = (
        (values <= low if signed else values >= high)
        & (values <= low).any(axis=0)
        & (values >= high).any(axis=0)
    )
    alone = (widest + 1 if signed else len(numbers) - widest - 1) == 1
    if alone and (over > _OVER or (away.mean(axis=0) > SELDOM).mean() <= 0.5):
        return values, 0
    values[away] += 2**bits if signed else -(2**bits)
    return values, int(away.sum())


def _bits(numbers: FloatArray) -> int:
    """Tell of how many bits counts are by how far they reach."""
    return next(bits for bits in (8, 10, 12, 14, 16, 24) if np.ptp(numbers) < 2**bits)


def mending(readings: ArrayLike, count: int) -> str:
    """Say which counts of readings (n, taxels) `unwrapped` mends."""
    numbers = np.unique(np.asarray(readings, dtype=float))
    numbers = numbers[~np.isnan(numbers)] / (np.diff(numbers).min() if (numbers % 1).any() else 1)
    end = 2 ** _bits(np.round(numbers))
    if numbers[0] < 0:
        end //= 2
        return f"{count:,} counts above {end - 1} were stored with a sign, {-end} for {end}, and are mended"
    return f"{count:,} counts below 0 were stored without a sign, {end - 1} for -1, and are mended"


def find_idle(readings: ArrayLike, presses: NDArray[np.int64] | None = None) -> Idle:
    """Find the idle level and the sign of each taxel from readings (n, taxels) of presses.

    presses: (n,) whole numbers, the same for readings of one press, as `Scan` has them; None: each is one of its own.

    Readings times a constant, plus an offset a taxel, or turned round give the same rise. A taxel that is not idle in a
    tenth of the presses has the sign of most others; so has one that rests or saturates at an end with the fewer of its
    readings, and where most do, more load reads more. Readings to the digit of three presses or more are of failed
    frames, or of an untouched pad, and are left out; two may be one that was kept twice. Of fewer than fifty presses
    nothing is told: taxels rest at 0.
    """
    every = np.asarray(readings, dtype=float)
    _, same = np.unique(every, axis=0, return_inverse=True)
    of_press = np.arange(len(every)) if presses is None else presses
    times = np.bincount(np.unique(np.column_stack([same.ravel(), of_press]), axis=0)[:, 0])
    own = (times < _FAILED)[same.ravel()]
    own &= ~failed_cells(every).any(axis=1)
    values = every[own] if own.sum() >= _FEWEST else every
    taxels = values.shape[1]
    if len(values) < _FEWEST:
        return Idle(np.zeros(taxels), np.ones(taxels), np.zeros(taxels, dtype=bool), 1.0)
    halves = [(_lower_half(column), _lower_half(-column)) for column in values.T]
    count = max(3, int(np.ceil(_SHARED * len(values))))
    widths = np.array([[_shortest(half, count) for half in pair] for pair in halves])
    extent = np.ptp(values, axis=0)
    near_equal, felt = _EQUAL * extent, extent > _FELT * np.quantile(extent, 0.9)
    counts = np.array([[len(half) for half in pair] for pair in halves])
    both = (widths <= _NARROW * extent[:, None]).all(axis=1)
    with np.errstate(invalid="ignore"):
        rises, falls = (felt & (widths[:, end] < widths[:, 1 - end] - near_equal) for end in (0, 1))
    # A taxel that saturates reads one end again and again, too; one that is mostly loaded has few readings at rest.
    # Full scale is one number for all taxels, without noise: where the other end has noise, it may be the one at rest.
    equal = widths <= near_equal[:, None]
    scale = (values == values.max()) | (values == values.min())
    at_scale = both & (equal[:, 0] != equal[:, 1]) & ((scale.mean(axis=0) >= _SHARED).sum() > 1)
    fewer = [
        both & (counts[:, end] < np.where(at_scale & equal[:, end], 2, 1) * counts[:, 1 - end])
        for end in (0, 1)
    ]
    doubtful = (rises & fewer[0]) | (falls & fewer[1])
    rises, falls = rises & ~doubtful, falls & ~doubtful
    most = -1.0 if falls.sum() > max(rises.sum(), doubtful.sum()) else 1.0
    # At rest all taxels are about as noisy. So where only one end holds readings enough, a wide one is no rest.
    tight = widths.min(axis=1)
    usual = float(np.median(tight[rises | falls])) if (rises | falls).any() else 0.0
    quiet = (tight <= _QUIET * usual + near_equal) | np.isfinite(widths).all(axis=1)
    rises, falls = rises & quiet, falls & quiet
    sign = np.where(rises, 1.0, np.where(falls, -1.0, most))
    chosen = [pair[0 if of_taxel > 0 else 1] for pair, of_taxel in zip(halves, sign, strict=True)]
    level = np.array([_shorth(half, equal) for half, equal in zip(chosen, near_equal, strict=True)])
    known = np.isfinite(np.where(sign > 0, widths[:, 0], widths[:, 1])) & (quiet | ~felt)
    known &= ~np.where(sign > 0, *fewer)
    above = values * sign - level
    loaded = above[:, felt][above[:, felt] > np.max(above[:, felt], axis=0) / 2]
    typical = float(np.median(loaded)) if len(loaded) else 1.0
    return Idle(level * sign, sign, known, typical, repeated=len(every) - len(values))


def find_rest(readings: ArrayLike, presses: NDArray[np.int64] | None = None) -> Idle:
    """Find the idle level as `find_idle` does, of taxels of which it can be told apart from load: to take it off.

    readings, presses: as of `find_idle`. Where objects cover a taxel in most presses, its readings lie closest together
    at some load. So a level is known if it is at the end of its taxel's range, but for noise and drift, and if half of
    the readings are there, each beside those before and after it, or those that are there are as close as noise.
    Another taxel has the sign of most that are known, and the end of its range for a level, or their furthest if that
    is nearer to rest.
    """
    values = np.asarray(readings, dtype=float)
    idle = find_idle(values, presses)
    if not idle.known.any():
        return idle
    above, level = values * idle.sign, idle.level * idle.sign
    low, high = np.quantile(above, _TAILS, axis=0)
    wide = float(np.quantile(high - low, 0.9))
    halves = [_lower_half(column) for column in above.T]
    widths = np.array([_shortest(half, (len(half) + 1) // 2) for half in halves])
    noise = float(np.quantile(widths[high - low >= _FELT * wide], 0.1))
    noise = noise if noise <= _LOUD * wide else 0.0
    blocks = np.array_split(above, np.clip(len(above) // _BLOCK, 2, 8))
    ends = np.array([np.quantile(block, _END, axis=0, method="higher") for block in blocks])
    at_end = [block <= end + _END * wide + 2 * noise for block, end in zip(blocks, ends, strict=True)]
    held = np.concatenate(at_end).mean(axis=0) >= _HELD
    drift = float(np.quantile(np.ptp(ends[:, held], axis=0), 0.1)) if held.any() else 0.0
    drift = drift if drift <= _MOVED * wide else 0.0
    known = (
        idle.known & (held | (widths <= 2 * noise)) & (level - low <= _END * wide + _OF_NOISE * noise + drift)
    )
    if not known.any():
        return replace(idle, known=known)
    most = -1.0 if (idle.sign[known] < 0).mean() > 0.5 else 1.0
    end = np.quantile(values * most, _TAILS[0], axis=0)
    furthest = float((idle.level * most)[known & (idle.sign == most)].max())
    return replace(
        idle,
        level=np.where(known, idle.level, most * np.minimum(end, furthest)),
        sign=np.where(known, idle.sign, most),
        known=known,
    )


def given_idle(level: ArrayLike, readings: FloatArray) -> Idle:
    """Take the idle level as it is known: a number, (taxels,), or idle frames (n, taxels), whose median it is.

    readings: (n, taxels), which tell the sign: to the side on which a taxel's readings go further.
    Raises InputError for another number of taxels, and for what is not finite.
    """
    taxels = readings.shape[1]
    frames = np.atleast_1d(np.asarray(level, dtype=float))
    if frames.shape[-1] not in (1, taxels) or frames.ndim > 2 or not frames.size:
        raise InputError(f"idle readings have the shape {frames.shape}; the pad has {taxels} taxels")
    middle = np.broadcast_to(np.median(finite(np.atleast_2d(frames), "idle readings"), axis=0), taxels)
    low, high = (
        np.abs(np.quantile(readings - middle, _TAILS, axis=0)) if len(readings) else np.ones((2, taxels))
    )
    felt = high + low > _FELT * np.quantile(high + low, 0.9)
    most = -1.0 if low[felt].sum() > high[felt].sum() else 1.0
    return Idle(
        middle.copy(), np.where(felt, np.where(low > high, -1.0, 1.0), most), np.ones(taxels, dtype=bool), 1.0
    )


def settled(scan: Scan, zero: str = "auto", frames: ArrayLike | None = None) -> tuple[Scan, str]:
    """Bring the readings of a scan to 0 at rest and above 0 under load; say in a line what was done.

    zero: "auto" to find the idle level in the training readings, of which nothing is taken off where most taxels rest
    near 0; a number, the level of all taxels; "off" to leave readings as they are. frames: idle readings (taxels,) or
    (n, taxels) instead. Unless "off", counts that left their bits are mended, taxels that fail often and presses with
    failed cells are left out; where what taxels read at rest drifts from press to press, it is said. Raises InputError
    for another word, for frames of another pad, and if no press is left.
    """
    mended, wrapped = (scan.readings, 0) if zero == "off" else unwrapped(scan.readings)
    if wrapped:
        taken, said = settled(replace(scan, readings=mended), zero, frames)
        return taken, f"{mending(scan.readings, wrapped)}; {said}"
    broken = np.zeros(scan.readings.shape[1], dtype=bool) if zero == "off" else flickering(scan.readings)
    if broken.any():
        stated, why = dict(scan.meta.get("left_out", {})), "it fails in many presses, as 65535 is"
        of_pad = np.setdiff1d(np.arange(len(broken) + len(stated)), [*map(int, stated)])[broken].tolist()
        if frames is not None and stated and np.shape(frames)[-1:] == broken.shape:
            frames = np.asarray(frames)[..., ~broken]  # without those that were left out before
        reduced = replace(
            scan, readings=scan.readings[:, ~broken], taxel_xy=scan.taxel_xy[~broken],
            sequence=None if scan.sequence is None else scan.sequence[..., ~broken],
            meta={**scan.meta, "left_out": {**stated, **dict.fromkeys(map(str, of_pad), why)}},
        )  # fmt: skip
        taken, said = settled(reduced, zero, frames)
        return taken, f"taxel {', '.join(map(str, of_pad))} is left out: {why}; {said}"
    failed = np.zeros(scan.readings.shape, dtype=bool) if zero == "off" else failed_cells(scan.readings)
    whole: NDArray[np.bool_] = np.asarray(~failed.any(axis=1))
    if lost := int((~whole).sum()):
        example = short(float(scan.readings[failed][0]))
        if lost == len(scan):
            raise InputError(f"every press has a failed cell, such as {example}; write them as empty cells")
        taken, said = settled(scan.chosen(whole), zero, frames)
        cells = f"{failed.sum():,} failed cells, such as {example}"
        return taken, f"{lost:,} of {len(scan):,} readings with {cells}, are left out; {said}"
    if frames is not None:
        if zero != "auto":
            raise InputError("--zero and --idle both say what idle taxels read; leave one out")
        left_out = [int(taxel) for taxel in scan.meta.get("left_out", ())]
        if np.shape(frames)[-1:] == (scan.readings.shape[1] + len(left_out),):
            frames = np.delete(np.asarray(frames), left_out, axis=-1)
        idle = given_idle(frames, scan.readings)
    elif zero == "off":
        return scan, "readings are taken as they are"
    elif zero == "auto":
        train = scan.where("train")
        found_in = train if len(train) else scan
        idle = find_rest(found_in.readings, found_in.presses)
        if not idle.known.any():
            sessions = scan.meta.get("recordings", [])
            if sessions and all(one.get("calibrated") and all(one["calibrated"]) for one in sessions):
                return scan, "readings are as they were tared"
            return (
                scan,
                "what taxels read at rest cannot be told from these readings, so they were not zeroed; --zero N sets "
                "it, --idle FILE takes it from readings of the untouched pad",
            )
        if not idle.off_zero:
            return scan, "readings rest near 0 and rise under load; they are taken as they are"
    else:
        try:
            idle = given_idle(float(zero), scan.readings)
        except ValueError:
            raise InputError(f"--zero {zero!r}: give a number, auto or off") from None
    about = {"level": idle.level.tolist(), "sign": idle.sign.tolist()}
    sequence = None if scan.sequence is None else idle.rise(scan.sequence).astype(np.float32)
    taken = replace(
        scan, readings=idle.rise(scan.readings), sequence=sequence, meta={**scan.meta, "idle": about}
    )
    return taken, f"{idle.describe()}: readings are taken from there{_drift(scan, idle)}"


def _drift(scan: Scan, idle: Idle) -> str:
    """Say it where levels differ by a tenth of a typical rise between three to eight parts of the presses.

    Each part has as much of each object, so that what objects differ by is no drift. Where an object has fewer than
    three presses, the parts are what was pressed one after the other.
    """
    objects = [np.flatnonzero(scan.labels == label) for label in scan.letters]
    count, fewest = int(np.clip(len(scan) // 60, _PARTS, 8)), min(map(len, objects), default=0)
    if fewest < _PARTS:
        objects = [np.arange(len(scan))]
    else:
        count = min(count, fewest)
    part_of = np.zeros(len(scan), dtype=np.int64)
    for own in objects:
        part_of[own] = np.arange(len(own)) * count // len(own)
    parts = [find_rest(scan.readings[part_of == number]) for number in range(count)]
    told = np.all([part.known & (part.sign == idle.sign) for part in parts], axis=0)
    moved = float(np.median(np.ptp([part.level[told] for part in parts], axis=0))) if told.any() else 0.0
    if moved <= _DRIFTS * idle.typical:
        return ""
    return (
        f"; it drifts by {moved:.3g} from one part of the presses to another, {moved / idle.typical:.0%} of a typical "
        "rise, which is not taken off: press in shorter sessions, each with its own idle readings"
    )


def _lower_half(values: FloatArray) -> FloatArray:
    """Give what of a taxel's readings (n,) lies in the lower half of its range, in order."""
    low, high = np.quantile(values, _TAILS)
    return np.sort(values[values <= (low + high) / 2 + _EQUAL * np.ptp(values)])


def _shortest(ordered: FloatArray, count: int) -> float:
    """Give the width of the shortest interval that holds so many values; infinity if there are fewer."""
    if len(ordered) < count:
        return float("inf")
    return float(np.min(ordered[count - 1 :] - ordered[: len(ordered) - count + 1]))


def _shorth(ordered: FloatArray, near_equal: float) -> float:
    """Take the mean of the shortest interval that holds half of the readings (n,): of equal ones the lowest."""
    half = (len(ordered) + 1) // 2
    widths = ordered[half - 1 :] - ordered[: len(ordered) - half + 1]
    first = int(np.argmax(widths <= widths.min() + near_equal))
    return float(ordered[first : first + half].mean())
