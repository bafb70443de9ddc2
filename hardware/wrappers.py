"""Sources around another source: its readings corrected, recorded, or checked to be readings."""

from __future__ import annotations

from typing import Any

import numpy as np

from tactsim.core.counters import Counters
from tactsim.core.errors import short
from tactsim.core.pad import Pad
from tactsim.core.poses import FloatArray
from tactsim.core.reading import Reading
from tactsim.core.source import Source, SourceError, Wrapper
from tactsim.hardware.calibration import Calibration, Correction
from tactsim.hardware.recording import Recorder


class Corrected(Wrapper):
    """Another source, its readings corrected by a calibration."""

    calibrated = True

    def __init__(self, inner: Source, calibration: Calibration, name: str) -> None:
        """Correct what `inner`, called `name` in messages, gives.

        Raises InputError if it is corrected already, or has another number of taxels than the calibration.
        """
        super().__init__(inner)
        self._name, self._correction = name, Correction(calibration, inner.pad)
        self._check_uncorrected()

    @property
    def taxel_xy(self) -> FloatArray:  # type: ignore[override]
        """Tell where the taxels lie that the calibration keeps, (taxels, 2) mm."""
        return self._correction.taxel_xy

    def read(self, timeout: float | None = None) -> Reading:
        """Return the next reading, corrected; see `Source.read`.

        Raises SourceError also where a recording begins to be corrected by a calibration of its own.
        """
        reading = self.inner.read(timeout)
        self._check_uncorrected()
        return self._correction.apply(reading)

    def _check_uncorrected(self) -> None:
        if self.inner.calibrated:
            raise SourceError(f"{self._name} was recorded with a calibration of its own; give none")


class Recorded(Wrapper):
    """A source without bytes of its own, its readings written to a recording as they come."""

    has_bytes = True  # the recording has all

    def __init__(self, inner: Source, recorder: Recorder) -> None:
        super().__init__(inner)
        self._recorder = recorder

    def read(self, timeout: float | None = None) -> Reading:
        """Return the next reading after it was recorded; see `Source.read`."""
        reading = self.inner.read(timeout)
        self._recorder.reading(reading)
        return reading


class Checked(Wrapper):
    """A plug-in's source: what it gives is a reading of its pad, or an error names the plug-in."""

    def __init__(self, inner: Any, name: str) -> None:
        """Check that the plug-in `name` has opened a source. Raises SourceError if `inner` is none."""
        if not isinstance(inner, Source):
            raise SourceError(
                f"plug-in {name!r} opened {short(inner)}, which is no tactsim.core.source.Source"
            )
        for attribute, kind in (("pad", Pad), ("taxel_xy", np.ndarray), ("counters", Counters)):
            if not isinstance(getattr(inner, attribute, None), kind):
                raise SourceError(
                    f"plug-in {name!r} opened a source without `{attribute}`, a {kind.__name__}"
                )
        super().__init__(inner)
        self._name = name

    def read(self, timeout: float | None = None) -> Reading:
        """Return the next reading; see `Source.read`."""
        reading = self.inner.read(timeout)
        if not isinstance(reading, Reading) or reading.pressures.shape != (len(self.taxel_xy),):
            raise SourceError(
                f"plug-in {self._name!r} gave {short(reading)}, which is no Reading of {len(self.taxel_xy)} taxels"
            )
        return reading
