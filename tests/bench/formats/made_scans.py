"""Scans of any kind for the tests of the formats."""

from pathlib import Path

import h5py
import numpy as np
from hypothesis import strategies as st

from tactsim.core import Scan

LABELS = st.text(st.characters(codec="utf-8", exclude_categories=("C", "Z")), min_size=1, max_size=12)
# Signed zeros and the ends of what a scan takes have to come back too.
NUMBERS = [0.0, -0.0, 1e9, -1e9, 5e-324, 1 / 3, np.nextafter(1.0, 2.0)]


@st.composite
def scans(draw):
    """Draw a scan: one taxel or more, a split perhaps empty, labels of all alphabets, perhaps sequences."""
    count, taxels, frames = draw(st.integers(1, 9)), draw(st.integers(1, 7)), draw(st.integers(0, 4))
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    labels = draw(st.lists(LABELS, min_size=1, max_size=3))
    splits = draw(st.sampled_from([["train"], ["test"], ["train", "test"]]))
    meta = draw(st.dictionaries(st.text(max_size=5), st.none() | st.floats(-1e9, 1e9) | LABELS, max_size=3))
    return make_scan(
        rng, count, taxels, frames, labels, splits, {**meta, "unit": draw(st.sampled_from(["kPa", "N"]))}
    )


def make_scan(
    rng, count=6, taxels=4, frames=0, labels=("A", "É", "漢字"), splits=("train", "test"), meta=None
):
    """Make a scan of random numbers."""

    def numbers(*shape):
        return np.where(rng.random(shape) < 0.2, rng.choice(NUMBERS, shape), rng.normal(0, 30, shape))

    moving = {}
    if frames:
        moving = {
            "sequence": numbers(count, frames, taxels).astype(np.float32),
            "sequence_times": np.arange(1, frames + 1) / 200,
            "sequence_force": numbers(count, frames).astype(np.float32),
        }
    if rng.random() < 0.5:
        moving["loads"] = np.where(rng.random(count) < 0.3, np.nan, np.abs(numbers(count)))
    if rng.random() < 0.5:
        moving["presses"] = rng.integers(0, 3, count)
    if rng.random() < 0.5:
        moving["moments"] = rng.integers(1, 5, count) / 4
        moving["views"] = rng.integers(0, 3, count)
    return Scan(
        numbers(count, taxels), numbers(count, 3), rng.choice(np.array(labels), count), rng.choice(splits, count),
        numbers(taxels, 2), {} if meta is None else meta, **moving,
    )  # fmt: skip


def as_matlab_saves(path, **arrays):
    """Write arrays as MATLAB's -v7.3 does: dimensions turned round, each with its class; a list of texts as a cell."""
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, array in arrays.items():
            if isinstance(array, list):
                for at, text in enumerate(array):
                    file[f"#refs#/{name}{at}"] = np.array([list(map(ord, text))], np.uint16).T
                    file[f"#refs#/{name}{at}"].attrs["MATLAB_class"] = np.bytes_("char")
                file[name] = np.array(
                    [[file[f"#refs#/{name}{at}"].ref for at in range(len(array))]], h5py.ref_dtype
                )
                file[name].attrs["MATLAB_class"] = np.bytes_("cell")
                continue
            is_text = array.dtype.kind == "U"
            stored = np.array([list(map(ord, text)) for text in array], np.uint16) if is_text else array
            file[name] = stored.T
            file[name].attrs["MATLAB_class"] = np.bytes_("char" if is_text else stored.dtype.name)
    with Path(path).open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM")
