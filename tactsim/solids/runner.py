"""The readings of a run with objects in space, and what it says of itself."""

from __future__ import annotations

from time import perf_counter
from typing import Any

from tactsim.bench.experiment import Gathered
from tactsim.bench.experiment import perform as perform_in_space
from tactsim.bench.trials import Progress
from tactsim.core.errors import InputError
from tactsim.core.provenance import had_another_shape
from tactsim.core.scan import Scan
from tactsim.solids.config import SpaceConfig
from tactsim.solids.solid_scan import SpaceScan
from tactsim.solids.surface_distance import Surface

__all__ = ["about_in_space", "gather_in_space", "perform_in_space"]  # the last is the old name of `perform`


def gather_in_space(config: SpaceConfig, *, progress: Progress) -> Gathered:
    """Touch the objects or load the readings, and take from the objects what the error needs.

    Raises InputError if an object has no training readings.
    """
    from tactsim.solids import scan_solids, solids_of

    start = perf_counter()
    solids = solids_of(config.scan_options)
    if config.scan is None:
        scan, work = scan_solids(
            config.scan_options, progress=lambda done, total: progress("press", done, total)
        )
    else:
        scan, work = SpaceScan.load(config.scan), {"presses": 0, "skipped": {}}
    names = tuple(solid.name for solid in solids)
    trained = scan.where("train").letters
    for name in names:
        if name not in trained:
            raise InputError(
                f"--scan {config.scan} holds no training readings of {name}; it has {', '.join(trained)}"
            )
    for solid in solids[len(config.scan_options.objects) :]:  # those of files
        if had_another_shape(scan.meta, solid.name, solid.digest):
            raise InputError(
                f"--scan {config.scan} touched another {solid.name} than the --shape of that name; give the file "
                f"that was scanned"
            )
    return Gathered(
        scan.of_letters(names), names, work, perf_counter() - start,
        objects={solid.name: Surface.of(solid) for solid in solids},
    )  # fmt: skip


def about_in_space(config: SpaceConfig, scan: Scan) -> dict[str, Any]:
    """Say what a run in space says beside the rest: its protocol, and the taxels' centres on the pad, mm.

    Only results of one protocol share a table.
    """
    assert isinstance(scan, SpaceScan)
    order = "touches from random sides" if config.explore == "random" else "touches chosen by information"
    protocol = f"objects in space, {order}" + (f", hand {config.hand.stem}" if config.hand else "")
    return {"protocol": protocol, "taxel_points": scan.taxel_points.tolist()}
