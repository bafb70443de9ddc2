import threading
from contextlib import contextmanager

import numpy as np

from tactsim.hardware.calibration import Calibration
from tactsim.hardware.device import Device
from tactsim.hardware.emulator import Faults, serve_pty, serve_tcp

LAYOUT = [
    {"is": "header", "bytes": "AA 55"},
    {"is": "length", "of": "after"},
    {"is": "index", "size": 2},
    {"is": "clock", "size": 2, "tick_s": 0.001},
    {"is": "taxels", "count": 6, "bits": 12},
    {"is": "checksum", "kind": "crc16-modbus"},
    {"is": "footer", "bytes": "0D 0A"},
]
PAD = {"rows": 2, "columns": 3, "no_seam": True, "unread_columns": 0}


def small_device(**changes):
    """A pad of 2x3 taxels with described frames of 20 bytes."""
    codec = {"kind": "fields", "kpa_per_count": 0.5, "zero": 100, "layout": LAYOUT} | changes.pop("codec", {})
    return Device.model_validate({"name": "small", "codec": codec, "pad": PAD, "deadline": 2.0} | changes)


def singletact(taxels=25, parts=None, **codec):
    """SingleTact arrays; the pad is one row of all their taxels."""
    parts = parts or [{}]
    return Device.model_validate(
        {"name": "singletact",
         "codec": {"kind": "singletact", "taxels": taxels, "full_scale_kpa": 100.0} | codec,
         "pad": {"rows": 1, "columns": taxels * len(parts), "no_seam": True, "unread_columns": 0},
         "part": parts, "deadline": 2.0, "pair_within_s": 0.5 if len(parts) > 1 else None}
    )  # fmt: skip


def csv_device(taxels=6, **codec):
    pad = PAD if taxels == 6 else {"rows": 1, "columns": taxels, "no_seam": True, "unread_columns": 0}
    return Device.model_validate(
        {"name": "csv", "codec": {"kind": "pps-csv", "taxels": taxels, **codec}, "pad": pad}
    )


def described(layout, taxels=6, **codec):
    """A pad of one row whose frames have a layout; a count is 1 kPa."""
    content = {"layout": layout, "zero": 0, "kpa_per_count": 1.0} | codec
    return small_device(codec=content, pad={"rows": 1, "columns": taxels, "no_seam": True})


def line_device(taxels=6, **codec):
    """A pad of one row that prints lines of numbers; a count is 1 kPa."""
    content = {"kind": "csv", "taxels": taxels, "kpa_per_count": 1.0} | codec
    pad = {"rows": 1, "columns": taxels, "no_seam": True}
    return Device.model_validate({"name": "lines", "codec": content, "pad": pad})


def counting_array(side):
    """Write the device file of an array of side x side taxels, in counts and of twice the paper's pitch."""
    return f"""name = "{side}x{side}"
[codec]
kind = "pps-csv"
taxels = {side * side}
unit = "count"
[pad]
rows = {side}
columns = {side}
pitch_x = 3.8
pitch_y = 3.8
taxel_width = 3.4
taxel_height = 3.4
no_seam = true
unread_columns = 0
"""


def calibration(**changes):
    """Calibrate six taxels, which rest at 1 kPa where nothing else is said."""
    values = {
        "device": "small", "port": "p", "taken": "2026-01-01T00:00:00Z", "frames": 50,
        "tare": (1.0,) * 6, "noise": (0.1,) * 6, "gain": (1.0,) * 6,
    }  # fmt: skip
    return Calibration.model_validate(values | changes)


def ramp(device):
    """Pressures that differ in every taxel and change with time."""
    return lambda now: 10 + np.arange(device.pad.taxels) * 1.0 + 5 * np.sin(now)


@contextmanager
def serving(emulated, *, on="pty", faults=None, seed=0, **options):
    """Serve an emulated device on a real pty or TCP port; gives the name that a host opens."""
    ready, stop, urls = threading.Event(), threading.Event(), []

    def note(url):
        urls.append(url)
        ready.set()

    serve = {"pty": serve_pty, "tcp": serve_tcp}[on]
    faults, rng = faults or Faults(), np.random.default_rng(seed)
    thread = threading.Thread(
        target=serve,
        args=(emulated, faults, rng),
        kwargs={"ready": note, "stop": stop, **options},
        daemon=True,
    )
    thread.start()
    try:
        assert ready.wait(5)
        yield urls[0]
    finally:
        stop.set()
        thread.join(5)
        assert not thread.is_alive()
