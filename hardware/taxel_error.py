"""How far recorded readings are from predicted ones."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactsim.core.poses import FloatArray

_UNTOUCHED = 0.02  # share of a reading's largest predicted pressure below which a taxel is untouched


@dataclass(frozen=True, eq=False)
class TaxelError:
    """How far recorded readings are from predicted ones, over all taxels.

    rms, bias: kPa. relative: rms over the mean pressure of touched taxels. correlation: Pearson's.
    per_taxel: (taxels,) rms, kPa. per_press: (n,) rms, kPa.
    """

    rms: float
    bias: float
    relative: float
    correlation: float
    per_taxel: FloatArray
    per_press: FloatArray


def taxel_error(recorded: FloatArray, predicted: FloatArray) -> TaxelError:
    """Compare readings (n, taxels) kPa with what was predicted for the same presses."""
    difference = recorded - predicted
    touched = ~untouched(predicted)
    rms = float(np.sqrt((difference**2).mean()))
    typical = float(predicted[touched].mean()) if touched.any() else np.nan
    varies = recorded.std() > 0 and predicted.std() > 0
    return TaxelError(
        rms=rms,
        bias=float(difference.mean()),
        relative=rms / typical,
        correlation=float(np.corrcoef(recorded.ravel(), predicted.ravel())[0, 1]) if varies else np.nan,
        per_taxel=np.sqrt((difference**2).mean(axis=0)),
        per_press=np.sqrt((difference**2).mean(axis=1)),
    )


def untouched(predicted: FloatArray) -> NDArray[np.bool_]:
    """Tell which taxels of predicted readings (n, taxels) nothing touches."""
    return predicted <= _UNTOUCHED * np.max(predicted, axis=1, keepdims=True, initial=1e-9)
