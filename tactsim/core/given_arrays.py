"""Arrays of other people, brought into the form that a scan has: see `Scan.from_arrays`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tactsim.core.errors import InputError, short

if TYPE_CHECKING:
    from tactsim.core.pad import Pad


def readings_a_press(values: Any, pad: Pad) -> NDArray[Any]:
    """Bring readings into the shape (n, taxels): the pictures of a pad in a row, several images of a press averaged.

    values: (n, taxels), (n, rows, columns), (n, images, taxels) or (n, images, rows, columns) numbers. Raises
    InputError for another shape.
    """
    array = np.asarray(values)
    if array.dtype.kind not in "fiu":
        raise InputError(f"readings are {array.dtype}, no numbers")
    picture = (pad.rows, pad.columns)
    if array.ndim > 2 and array.shape[-2:] == picture:
        array = array.reshape(*array.shape[:-2], pad.taxels)
    if array.ndim not in (2, 3) or array.shape[-1] != pad.taxels or not all(array.shape[1:]):
        raise InputError(
            f"readings have the shape {np.shape(values)}; a pad of {pad.rows}x{pad.columns} taxels asks for (presses, "
            f"{pad.taxels}), (presses, {pad.rows}, {pad.columns}), or several images of each press between the two"
        )
    return array if array.ndim == 2 else array.mean(axis=1)


def names_of(values: Any, what: str) -> NDArray[np.str_]:
    """Read names (n,): texts as they are without blanks around them, bytes as UTF-8, whole numbers written out.

    Raises InputError for anything else.
    """
    array = np.asarray(values)
    if array.dtype.kind in "SO":
        array = np.array(_as_texts(array.ravel(), what), dtype=np.str_).reshape(array.shape)
    array = array.reshape(-1) if array.size == max(array.shape, default=1) else array  # a row or a column
    if array.ndim != 1 or array.dtype.kind not in "Ufiu":
        raise InputError(f"{what} are {array.dtype} of shape {array.shape}, no row of names or whole numbers")
    if array.dtype.kind == "U":
        return np.char.strip(array)
    if not (np.isfinite(array).all() and (array == np.round(array)).all() and (np.abs(array) < 2**53).all()):
        raise InputError(
            f"{what} are numbers that are not whole, such as {short(float(array[0]))}; give names"
        )
    return array.astype(np.int64).astype(np.str_)


def splits_of(values: Any, count: int) -> NDArray[np.str_]:
    """Read a split (n,): "train" or "test", or whether each press is to train on; None: all are.

    Raises InputError for anything else.
    """
    if values is None:
        return np.full(count, "train")
    array = np.asarray(values)
    if array.dtype.kind in "fiu" and np.isin(array, (0, 1)).all():
        array = array.astype(bool)
    if array.dtype.kind == "b":
        return np.where(array.reshape(-1), "train", "test")
    if array.dtype.kind != "U":
        raise InputError("the split is neither 'train' and 'test' nor 1 (to train on) and 0 (to test with)")
    return names_of(array, "split")


def _as_texts(values: NDArray[Any], what: str) -> list[str]:
    """Read texts or bytes. Raises InputError for other objects, and for bytes that are no UTF-8."""
    texts = []
    for value in values.tolist():
        if isinstance(value, bytes):
            try:
                value = value.decode()
            except UnicodeDecodeError:
                raise InputError(
                    f"{what} hold {short(value)}, which is no UTF-8; give them as texts"
                ) from None
        if not isinstance(value, str):
            raise InputError(
                f"{what} hold {short(value)}, which is no text; give names, as in labels.astype(str)"
            )
        texts.append(value)
    return texts
