"""Options of the world in which letter and pad stay parallel, for tests of what does not depend on tilt."""

from contextlib import contextmanager

import pytest

from tactsim.press import PressOptions, ScanOptions


def level_press(**options):
    """Press with a rigid wrist, where nothing else is said."""
    return PressOptions(**({"wrist_stiffness": None} | options))


def level_scan(**options):
    """Scan without tilt and with a rigid wrist, where nothing else is said."""
    return ScanOptions(**({"placement_tilt": 0.0, "press": level_press()} | options))


@contextmanager
def at_few_angles():
    """Scan at 3 angles instead of 12, where 192 poses would show nothing more: 48 poses, in pieces of 16."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("tactsim.press.scan_poses.ANGLES", 3)
        patch.setattr("tactsim.press.scanning._CHUNK", 16)
        yield
