import threading
from contextlib import contextmanager

import numpy as np

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
        {
            "name": "singletact",
            "codec": {"kind": "singletact", "taxels": taxels, "full_scale_kpa": 100.0} | codec,
            "pad": {"rows": 1, "columns": taxels * len(parts), "no_seam": True, "unread_columns": 0},
            "part": parts,
            "deadline": 2.0,
            "pair_within_s": 0.5 if len(parts) > 1 else None,
        }
    )


def csv_device(taxels=6, **codec):
    pad = PAD if taxels == 6 else {"rows": 1, "columns": taxels, "no_seam": True, "unread_columns": 0}
    return Device.model_validate(
        {"name": "csv", "codec": {"kind": "pps-csv", "taxels": taxels, **codec}, "pad": pad}
    )


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
