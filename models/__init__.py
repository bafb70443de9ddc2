"""The shapes that are pressed: CSG letters, their areas, moments and symmetry, and their export.

Lives here: solids and outlines in mm, what follows from a shape alone, and, because every other
folder stands on this one, the error of a wrong input (`errors`) and whole-or-nothing writing
(`files`). Does not live here: anything that knows a sensor, a force, a reading or a map.
"""

from models.errors import InputError
from models.export import export
from models.glyphs import names, parse_letters
from models.letter import Letter, Part, Rectangle, letter
from models.shapes import shape

__all__ = [
    "InputError",
    "Letter",
    "Part",
    "Rectangle",
    "export",
    "letter",
    "names",
    "parse_letters",
    "shape",
]
