from dataclasses import replace

import numpy as np
import pytest
from synthetic import make_scan, paper_poses

from tactsim import estimators


@pytest.mark.parametrize("split", ["25x25x4", "3x5x2", "1x1x1", "17x33x2"])
def test_tiles_that_hang_over_the_tables_read_nothing_beyond_them(split):
    scan = make_scan("EI", poses=paper_poses(3, 4))
    filter = estimators.create("histogram", split=split)
    filter.fit(scan)
    for name in ("_bins", "_blocks"):
        slices = getattr(filter, name)
        around = np.full(3 * slices.nodes.size, np.nan, dtype=np.float32)
        inside = around[slices.nodes.size : 2 * slices.nodes.size]
        inside[:] = slices.nodes
        setattr(filter, name, slices._replace(nodes=inside))
    rng = np.random.default_rng(0)
    for _ in range(10):
        filter.reset(rng)
        # Anywhere from the middle of the map to far off it, so that every edge is hung over.
        for reach in (10, 30, 60, 1e4, 1e9):
            filter.update(scan.readings[rng.integers(len(scan))], rng.uniform(-reach, reach, 3))
        letters = list(filter.estimate().probabilities.values())
        assert np.isfinite(letters).all()
        assert np.isfinite(filter._belief.upper).all()


def test_skipped_blocks_are_never_above_their_bound(scan):
    # The bound is what makes skipping exact; check it bin by bin against the full filter.
    lazy, full = (estimators.create("histogram", split="20x20x6", skip=skip) for skip in (True, False))
    lazy.fit(scan)
    full.fit(scan)
    for seed in range(5):
        rng = np.random.default_rng(seed)
        lazy.reset(rng)
        full.reset(rng)
        for count in range(1, 9):
            reading, pose = scan.readings[rng.integers(len(scan))], rng.uniform(-15, 15, 3)
            lazy.update(reading, pose)
            full.update(reading, pose)
            _, _, tall, wide = lazy._belief.size
            bound = lazy._belief.upper + lazy._history.terms.ceiling[count]
            spread = bound.repeat(tall, axis=2).repeat(wide, axis=3)[:, :, :20, :20]
            assert (full.log_belief() <= spread + 1e-9).all()


@pytest.mark.parametrize("name", ["histogram", "particle"])
@pytest.mark.parametrize(
    ("field", "value"), [("table", 2), ("table", -1), ("taxel", 36), ("weight", -1.0), ("weight", np.nan)]
)
def test_a_likelihood_that_names_what_does_not_exist_is_stopped(name, field, value):
    scan = make_scan("EI", poses=paper_poses(2, 2))
    filter = estimators.create(name)
    filter.fit(scan)
    filter.reset(np.random.default_rng(0))
    sound = filter.likelihood.evidence(scan.readings[0])
    faulty = getattr(sound, field).copy()
    faulty[3] = value
    with pytest.raises(ValueError, match="a likelihood"):
        filter.take(replace(sound, **{field: faulty}), np.zeros(3))
