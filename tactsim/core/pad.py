"""`Pad`: where the taxels of a tactile array lie, and how far the surface that carries load reaches.

The functions give the lengths of a pad of which only the taxels are known, which what is stated in mm for the default
pad follows: its pitch and its size.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import BeforeValidator, Field, model_validator

from tactsim.core.checking import Settings, checked
from tactsim.core.poses import FloatArray

OFFSET = 10.0  # mm: an object is hidden with x and y of T_R^O in [-OFFSET, OFFSET] (paper, section IV)
_SIZE = math.sqrt(11.7 * 11.4)  # mm, of the paper's pad by `size`
# Pads whose sizes differ by less are taken as equal: of one, a row may be masked or a seam narrower.
_ALIKE = 0.03
# Of the paper's pad: one of other measures has no seam and no unread columns unless it says so.
_PAPERS = {"rows": 6, "columns": 6, "pitch_x": 1.9, "pitch_y": 1.9, "taxel_width": 1.8, "taxel_height": 1.8}

Length = Annotated[float, Field(ge=1e-3, le=1000)]


class Pad(Settings):
    """A flat array of rectangular taxels; the default is the paper's (section II, figure 3a).

    Two 6x4 arrays lie side by side and the centre 6x6 taxels are read: 1.8 mm taxels, 1.9 mm
    apart, 2.2 mm across the seam, which makes the published 11.6 x 11.3 mm. Rows run along +y,
    columns along +x, and the origin of the sensor frame is the middle of the taxels read. The
    surface that carries load reaches to the outer edges of the outermost taxels, read or not; the
    gaps between taxels carry load too. What lies outside carries nothing (assumed).
    A pad of other measures has no seam and no unread columns unless it says so.
    """

    rows: int = Field(6, ge=1, le=200, description="rows of taxels that are read")
    columns: int = Field(6, ge=1, le=200, description="columns of taxels that are read")
    pitch_x: Length = Field(1.9, description="mm from one column's centre to the next")
    pitch_y: Length = Field(1.9, description="mm from one row's centre to the next")
    taxel_width: Length = Field(1.8, description="mm that a taxel measures along a row")
    taxel_height: Length = Field(1.8, description="mm that a taxel measures along a column")
    seam: float | None = Field(0.4, ge=0, le=100, description="mm between the taxels beside the middle")
    unread_columns: int = Field(
        1, ge=0, le=100, description="columns each side that carry load but are not read"
    )
    unread_rows: int = Field(0, ge=0, le=100, description="rows each end that carry load but are not read")

    @model_validator(mode="before")
    @classmethod
    def _without_seam(cls, values: Any) -> Any:
        """Read `no_seam = true` as `seam = "none"`, and give a pad of other measures nothing that is the paper's."""
        if isinstance(values, dict):
            if any(str(values.get(name, usual)) != str(usual) for name, usual in _PAPERS.items()):
                values = {"seam": None, "unread_columns": 0, **values}
            stated = values.get("no_seam")
            if stated in (True, "true"):
                values = {**values, "seam": None}
            if stated in (True, False, "true", "false"):
                values = {name: value for name, value in values.items() if name != "no_seam"}
        return values

    @model_validator(mode="after")
    def _taxels_do_not_overlap(self) -> Pad:
        if self.taxel_width > self.pitch_x or self.taxel_height > self.pitch_y:
            size = f"{self.taxel_width:g} x {self.taxel_height:g} mm"
            pitch = f"{self.pitch_x:g} x {self.pitch_y:g} mm"
            raise ValueError(
                f"taxels overlap: taxel_width, taxel_height are {size}, pitch_x, pitch_y {pitch}"
            )
        if self.seam is not None and self.columns % 2:
            raise ValueError('a seam in the middle needs an even number of columns; give seam = "none"')
        return self

    @classmethod
    def load(cls, path: str | Path) -> Pad:
        """Read a pad from a TOML file with any of the fields above, or from the table [pad] of a device file.

        `no_seam = true` and `seam = "none"` say the same: one array.
        Raises InputError if the file cannot be read or a value is unknown or out of range.
        """
        from tactsim.core.documents import read_toml  # most pads are the paper's

        table = read_toml(path, "pad")
        return checked(cls, table.get("pad", table), f"pad {path}")

    @property
    def taxels(self) -> int:
        """Count the taxels that are read."""
        return self.rows * self.columns

    @property
    def taxel_xy(self) -> FloatArray:
        """Centres of the taxels that are read, (rows * columns, 2) mm; taxel = columns * row + column."""
        x, y = self.column_edges[:, :2].mean(axis=1), self.row_edges[:, :2].mean(axis=1)
        centres = np.stack(np.broadcast_arrays(x[None, :], y[:, None]), axis=-1).reshape(-1, 2)
        centres.setflags(write=False)
        return centres

    @property
    def column_edges(self) -> FloatArray:
        """Left and right edge of each column that is read, (columns, 2) mm."""
        return _edges(self.columns, 0, self.pitch_x, self.taxel_width, self.seam)

    @property
    def row_edges(self) -> FloatArray:
        """Lower and upper edge of each row that is read, (rows, 2) mm."""
        return _edges(self.rows, 0, self.pitch_y, self.taxel_height, None)

    @property
    def load_bounds(self) -> tuple[float, float, float, float]:
        """Bound the surface that carries load: (x low, x high, y low, y high) mm."""
        x = _edges(self.columns, self.unread_columns, self.pitch_x, self.taxel_width, self.seam)
        y = _edges(self.rows, self.unread_rows, self.pitch_y, self.taxel_height, None)
        return float(x[0, 0]), float(x[-1, 1]), float(y[0, 0]), float(y[-1, 1])

    def grid_lines(self, cells_per_taxel: int, gap_cells: bool = False) -> tuple[FloatArray, FloatArray]:
        """Divide the surface that carries load into cells: returns their edges along x and along y, mm.

        Each taxel with its share of the gaps around it makes `cells_per_taxel` squared cells. With `gap_cells` the
        edges of taxels are lines too, so that a cell lies in one taxel or in none.
        """
        columns = _edges(self.columns, self.unread_columns, self.pitch_x, self.taxel_width, self.seam)
        rows = _edges(self.rows, self.unread_rows, self.pitch_y, self.taxel_height, None)
        return _lines(columns, cells_per_taxel, gap_cells), _lines(rows, cells_per_taxel, gap_cells)


def _edges(count: int, unread: int, pitch: float, taxel: float, seam: float | None) -> FloatArray:
    """Edges of all taxels along one axis, (count + 2 unread, 2) mm, symmetric about 0."""
    total = count + 2 * unread
    centres = pitch * (np.arange(total) - (total - 1) / 2)
    if seam is not None:  # push the halves apart by what the seam has over an ordinary gap
        centres += np.sign(centres) * (seam - (pitch - taxel)) / 2
    return np.stack([centres - taxel / 2, centres + taxel / 2], axis=1)


def _lines(edges: FloatArray, cells: int, gap_cells: bool) -> FloatArray:
    if gap_cells:
        inside = edges[:, :1] + (edges[:, 1:] - edges[:, :1]) * np.arange(cells + 1) / cells
        return np.unique(np.round(inside.ravel(), 12))
    borders = np.concatenate([edges[:1, 0], (edges[:-1, 1] + edges[1:, 0]) / 2, edges[-1:, 1]])
    inside = borders[:-1, None] + np.diff(borders)[:, None] * np.arange(cells) / cells
    return np.append(inside.ravel(), borders[-1])


def pitch(taxel_xy: FloatArray) -> float:
    """Give the distance between neighbouring taxels at taxel_xy (taxels, 2) mm: the median to the nearest one.

    A single taxel has none: 0.
    """
    if len(taxel_xy) < 2:
        return 0.0
    nearest = np.full(len(taxel_xy), np.inf)
    for taxel, place in enumerate(taxel_xy):
        away = np.hypot(*(taxel_xy - place).T)
        away[taxel] = np.inf
        nearest[taxel] = away.min()
    return float(np.median(nearest))


def size(taxel_xy: FloatArray) -> float:
    """Give the side, mm, of a square as large as the rectangle that taxels at (taxels, 2) mm cover; 0 for one taxel."""
    width, height = np.ptp(taxel_xy, axis=0) + pitch(taxel_xy)
    return math.sqrt(width * height)


def relative_size(taxel_xy: FloatArray) -> float:
    """Give the size of a pad with taxels at (taxels, 2) mm beside that of the paper's pad; 1 for a single taxel."""
    ratio = size(taxel_xy) / _SIZE
    return 1.0 if ratio == 0 or abs(ratio - 1) < _ALIKE else ratio


def offsets(taxel_xy: FloatArray) -> float:
    """Give the range of an object's place, mm: x and y of T_R^O are in plus and minus this, for a pad of any size.

    It is the paper's 10 mm for the paper's pad, and grows with the pad.
    """
    return OFFSET * relative_size(taxel_xy)


# A pad, or the path of a file that holds one.
PadOrFile = Annotated[Pad, BeforeValidator(lambda pad: Pad.load(pad) if isinstance(pad, str | Path) else pad)]
