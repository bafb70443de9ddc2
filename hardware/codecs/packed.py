"""The values of a frame as bytes: integers of 8 to 32 bits, packed without gaps, and floats."""

from __future__ import annotations

from typing import Literal

import numpy as np

from tactsim.core.poses import FloatArray
from tactsim.hardware.codecs.layout import Taxels

Endian = Literal["big", "little"]


def value_range(form: Taxels) -> tuple[float, float]:
    """Give the least and the greatest value that fits the bits."""
    if form.float:
        limit = float(np.finfo(np.float32).max)
        return -limit, limit
    if form.signed:
        return -(1 << form.bits - 1), (1 << form.bits - 1) - 1
    return 0, (1 << form.bits) - 1


def read_values(data: bytes, form: Taxels, endian: Endian) -> FloatArray:
    """Read the normal value of each taxel: (count,)."""
    if form.bits in (8, 16, 32):
        values = np.frombuffer(data, dtype=_dtype(form, endian))
    else:
        stream = np.unpackbits(np.frombuffer(data, np.uint8), bitorder=endian)
        count = form.count * form.axes
        words = stream[: count * form.bits].reshape(count, form.bits).astype(np.int64)
        values = words @ _weights(form, endian)
        values = np.where(values > value_range(form)[1], values - (1 << form.bits), values)
    return values.reshape(form.count, form.axes)[:, form.normal].astype(np.float64)


def write_values(normal: FloatArray, form: Taxels, endian: Endian) -> bytes:
    """Write the normal value of each taxel, (count,), rounded and kept within its bits; other axes are 0."""
    values = np.zeros((form.count, form.axes))
    values[:, form.normal] = np.clip(normal if form.float else np.round(normal), *value_range(form))
    if form.bits in (8, 16, 32):
        return values.astype(_dtype(form, endian)).tobytes()
    whole = values.reshape(-1, 1).astype(np.int64) % (1 << form.bits)
    bits = (whole // _weights(form, endian) % 2).astype(np.uint8)
    return np.packbits(bits.ravel(), bitorder=endian).tobytes()


def _dtype(form: Taxels, endian: Endian) -> str:
    kind = "f" if form.float else "i" if form.signed else "u"
    return f"{'>' if endian == 'big' else '<'}{kind}{form.bits // 8}"


def _weights(form: Taxels, endian: Endian) -> np.ndarray:
    """Say what each bit of a value counts, in the order in which the bits come."""
    ascending = 1 << np.arange(form.bits, dtype=np.int64)
    return ascending[::-1] if endian == "big" else ascending
