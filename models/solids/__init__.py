"""Solids: bodies in space that a pad touches from any side, their mass and symmetry.

Lives here: the catalogue of solids made by CSG, users' meshes, and what follows from a body's shape alone. Does not
live here: anything that knows a pad, a force or a reading.
"""

from tactsim.models.solids.catalogue import solid, solid_names
from tactsim.models.solids.solid import Solid, mirrored, solid_of
from tactsim.models.solids.solid_files import read_solid_file
from tactsim.models.solids.space_symmetry import SpaceSymmetry

__all__ = ["Solid", "SpaceSymmetry", "mirrored", "read_solid_file", "solid", "solid_names", "solid_of"]
