"""The shapes that are pressed: CSG letters and solids with relief, their areas, moments and symmetry, and their export.

Lives here: solids and outlines in mm, and what follows from a shape alone. Does not live here: anything
that knows a sensor, a force, a reading or a map.
"""

from tactsim.models.export import export
from tactsim.models.glyphs import names, parse_letters
from tactsim.models.letter import ConvexPart, Letter, Rectangle, letter, relief
from tactsim.models.shapes import shape
from tactsim.models.solids import Solid, mirrored, read_solid_file, solid, solid_names

__all__ = [
    "ConvexPart",
    "Letter",
    "Rectangle",
    "Solid",
    "export",
    "letter",
    "mirrored",
    "names",
    "parse_letters",
    "read_solid_file",
    "relief",
    "shape",
    "solid",
    "solid_names",
]
