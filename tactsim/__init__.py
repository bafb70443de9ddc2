"""The simulated tactile pad, and the data types that simulated and real pads share.

Lives here: poses, the pad's geometry, the press in MuJoCo, the sensor model, the 192-reading scan
and `Scan`, the file that holds it. Does not live here: what is learned from readings (estimators),
how it is scored (bench), or how a real pad is read (hardware).
"""

from models.errors import InputError
from tactsim.poses import compose, invert, transform, wrap_angle
from tactsim.scan import Scan

__all__ = ["InputError", "Scan", "compose", "invert", "transform", "wrap_angle"]
