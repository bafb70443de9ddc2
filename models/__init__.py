"""The shapes that are pressed: CSG letters and solids with relief, their areas, moments and symmetry, and their export.

Lives here: solids and outlines in mm, and what follows from a shape alone. Does not live here: anything
that knows a sensor, a force, a reading or a map.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from tactsim.models.glyphs import names, parse_letters
from tactsim.models.letter import Letter, letter, relief

if TYPE_CHECKING:
    from tactsim.models.parts import ConvexPart, Rectangle, export
    from tactsim.models.shapes import shape
    from tactsim.solids import Solid, mirrored, read_solid_file, solid, solid_names

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


def __getattr__(name: str) -> Any:
    # Letters do without files and solids, and a press of letters does not depend on them.
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    place = dict.fromkeys(("ConvexPart", "Rectangle", "export"), "models.parts") | {"shape": "models.shapes"}
    return getattr(import_module(f"tactsim.{place.get(name, 'solids')}"), name)
