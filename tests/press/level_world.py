"""Options of the world in which letter and pad stay parallel, for tests of what does not depend on tilt."""

from tactsim.press import PressOptions, ScanOptions


def level_press(**options):
    """Press with a rigid wrist, where nothing else is said."""
    return PressOptions(**({"wrist_stiffness": None} | options))


def level_scan(**options):
    """Scan without tilt and with a rigid wrist, where nothing else is said."""
    return ScanOptions(**({"placement_tilt": 0.0, "press": level_press()} | options))
