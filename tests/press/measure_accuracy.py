"""Print how exact the press is: every taxel of every press of A-Z and 0-9 against an exact reference.

python tests/press/measure_accuracy.py
"""

import numpy as np
from test_accuracy import LEAST_AREA, compare

from tactsim import models
from tactsim.press import PressOptions, ScanOptions
from tactsim.press.scan_poses import grid_poses


def main() -> None:
    """Print a row for each fineness of the bed."""
    print("cells per taxel side | 95 % of errors | largest | / contact pressure | the same, below 4 mm^2")
    for cells in (1, 2, 3):
        options = ScanOptions(press=PressOptions(cells_per_taxel=cells))
        errors, area = map(
            np.concatenate,
            zip(*(compare(name, options, grid_poses()) for name in models.names()), strict=True),
        )
        enough, sliver = area >= LEAST_AREA, (area > 0) & (area < LEAST_AREA)
        relative = errors.max(axis=1) / np.where(area > 0, 2e3 / np.where(area > 0, area, 1), 1)
        print(
            f"{cells} | {np.percentile(errors[enough], 95):.4f} kPa | {errors[enough].max():.4f} kPa "
            f"| {100 * relative[enough].max():.4f} % | {100 * relative[sliver].max():.4f} % of {sliver.sum()} presses"
        )


if __name__ == "__main__":
    main()
