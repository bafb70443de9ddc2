"""Touches of objects in space: a pad comes from any side, rests where it carries the force, and is read.

Lives here: the press of any mesh from any pose (`space_press`, over `pad_lattice` and `touch_kernels`), the touches
that teach an estimator an object and the scan of them (`solid_scanning`), and hands of several pads (`hand`). Does not
live here: the solids themselves (models.solids), and the press of letters on a plane (the package above).
"""
