"""Options that verbs of real readings share: which port, device and calibration, what is known of a table."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from tactsim.bench.cli import shared_options as shared
from tactsim.bench.cli.shared_options import refuse_typed
from tactsim.core.errors import InputError, unknown

if TYPE_CHECKING:
    from tactsim.bench.config import RunConfig
    from tactsim.bench.pad.guided import Station
    from tactsim.core.source import Source
    from tactsim.hardware.calibration import Calibration
    from tactsim.hardware.device import Device

Port = Annotated[
    list[str],
    typer.Option(
        help="Where the pad is: a serial port, socket://HOST:PORT, recording:FILE, or simulated:A@x,y,theta. "
        "Repeat for a pad on several ports, in their order."
    ),
]

DeviceName = Annotated[
    str,
    typer.Option(
        "--pad",
        "--device",
        help="The pad: a device file (.toml), or a built-in one; `bench devices` names them. For what is simulated a "
        "file of its measures will do.",
    ),
]

CalibrationFile = Annotated[
    Path | None, typer.Option("--calibration", help="Calibration file of `bench tare`.")
]

Web = Annotated[bool, typer.Option("--web", help="Show it also as a page on localhost.")]

WebPort = Annotated[
    int, typer.Option(min=0, max=65535, help="The port of that page; 0 takes any that is free.")
]


Zero = Annotated[
    str,
    typer.Option(
        help="What taxels read at rest: a number, auto to find the level and the sign of each taxel in the "
        "readings, or off."
    ),
]

IdleFile = Annotated[
    Path | None,
    typer.Option(
        "--idle",
        help="Readings of the untouched pad instead: a recording, a table with a column a taxel, or a .npy file.",
    ),
]

Shapes = Annotated[
    list[Path] | None,
    typer.Option(
        "--shape",
        help="The shape of the object that is called like the file: its centre, inertia and symmetry count in "
        "placement errors; repeat for several.",
    ),
]

Licence = Annotated[
    str | None,
    typer.Option(help="The scan's licence by its SPDX name, like CC-BY-4.0, if it does not state its own."),
]


def share(option: str, text: str) -> float:
    """Read a share such as 75%, or .75. Raises InputError for one that is not above 0, at most 1."""
    number = shared.finite_number(text.removesuffix("%"))
    found = 0.0 if number is None else number / (100 if text.endswith("%") else 1)
    if not 0 < found <= 1:
        raise InputError(f"{option} {text!r}: give a share above 0 %, at most 100 %, such as 75%")
    return found


def idle_frames(path: Path | None, opened: Callable[[Path], Source] | None = None) -> Any:
    """Read idle readings (n, taxels) from a table of text, also a recording with times, or a .npy file.

    opened: opens recordings of the pad, read in its order and unit, of which the first 10,000 readings are taken.
    Raises InputError if it is neither.
    """
    if path is None:
        return None
    import numpy as np

    from tactsim.core.documents import LARGE, read_text
    from tactsim.core.source import SourceError
    from tactsim.hardware.codecs.codec import CodecError, Frame
    from tactsim.hardware.codecs.pps_csv import read_table
    from tactsim.hardware.text_tables import numbers_of

    try:
        if path.suffix.lower() == ".npy":
            frames = np.load(path, allow_pickle=False).astype(float)
            return frames.reshape(len(frames), -1) if frames.ndim > 2 else frames
        if opened is not None:
            with suppress(SourceError), opened(path) as source:
                if read := [reading.pressures for reading in islice(source, 10_000)]:
                    return np.array(read)
        text = read_text(path, "idle readings", LARGE)
        with suppress(CodecError):
            _, recorded, _ = read_table(text.splitlines())
            return np.array([frame.values for frame in recorded if isinstance(frame, Frame)])
        return numbers_of(text)
    except (OSError, ValueError, EOFError) as error:
        raise InputError(f"--idle {path}: no table of numbers with a column a taxel ({error})") from error


def window(text: str) -> tuple[int, int]:
    """Read a window written as ROWSxCOLUMNS. Raises InputError for another text."""
    from tactsim.bench.config import whole_number

    rows, columns = (whole_number(word) for word in text.partition("x")[::2])
    if rows is None or columns is None:
        raise InputError(f"--cut {text!r}: write it as ROWSxCOLUMNS, like 5x5")
    return rows, columns


def refuse_without_page(context: typer.Context, web: bool) -> None:
    """Raise InputError if the user typed the port of a page that is not asked for."""
    if not web:
        refuse_typed(context, ("web_port",), "is the port of the page that --web shows; give that, too")


def load(name: str, calibration: Path | None = None) -> tuple[Device, Calibration | None]:
    """Read the device file and the calibration, if one is given."""
    from tactsim.hardware.calibration import Calibration
    from tactsim.hardware.device import load_device

    device, taken = load_device(name), None if calibration is None else Calibration.load(calibration)
    if taken is not None and taken.read_by not in ("", device.read_by()):
        raise InputError(
            f"{calibration} holds for another device file: [codec], [matrix] or [[part]] of {name} read the pad in "
            "another way since; take a tare again, by `bench tare`"
        )
    return device, taken


def played(source: Source, device: Device) -> tuple[Source, Device]:
    """Play a recording at the speed and on the device of its time; other sources are left as they are."""
    from tactsim.hardware.recorded import CsvReplay, Replay
    from tactsim.hardware.sources import Paced

    return (Paced(source), source.device) if isinstance(source, Replay | CsvReplay) else (source, device)


def counters_line(counters: dict[str, int]) -> str:
    """List the counters that are not zero."""
    from tactsim.core.counters import counter_words

    return ", ".join(f"{counter_words(name)} {count:,}" for name, count in counters.items() if count)


def plan_settings(
    ports: list[str],
    device: Device,
    calibration: Calibration | None,
    frames: int,
    force: str,
    patience: float | None,
) -> dict[str, Any]:
    """Give the fields of a session's plan that options and pad decide; a simulated hand has its own.

    Raises InputError for another simulated pad: a session would wait without end for its letter to be lifted.
    """
    from tactsim.bench.pad import simulated_hand
    from tactsim.bench.pad.simulated_hand import touch_above

    if ports != [simulated_hand.PLACE] and any(port.startswith("simulated:") for port in ports):
        raise InputError(
            f"--port {' '.join(ports)}: a letter that lies on the simulated pad is never lifted, so no press begins; "
            f"say {simulated_hand.PLACE}"
        )

    least, most = _force(force)
    noise = 0.0 if calibration is None else max(calibration.noise)
    settings = {
        "frames": frames, "touch_kpa": max(device.touch_kpa, touch_above(noise)), "least_force": least,
        "most_force": most, "patience": patience,
    }  # fmt: skip
    if ports == [simulated_hand.PLACE]:
        settings |= simulated_hand.settings() | ({} if patience is None else {"patience": patience})
    return settings


def _force(text: str) -> tuple[float, float]:
    least, most = (shared.finite_number(word) for word in text.partition(":")[::2])
    if least is None or most is None:
        raise InputError(f"--force {text!r}: write it as LEAST:MOST in N, like 0.5:5")
    return least, most


def measured(config: RunConfig, station: Station, settings: dict[str, Any]) -> bool:
    """Measure what is missing; tells whether all is there now, and if not, how to go on."""
    from tactsim.bench.config import chosen_letters
    from tactsim.bench.formats import load_scan
    from tactsim.bench.pad.guided import Wanted, check_pads, count_measured, measure
    from tactsim.bench.trials import fit
    from tactsim.estimators import create
    from tactsim.models import shape
    from tactsim.press import forward_model

    # What would refuse the presses is reported before anybody makes them.
    estimator = create(config.estimator, **config.options)
    if config.train_scan is None:
        raise InputError("a run on a pad's presses takes its training readings from --train-scan")
    train = load_scan(config.train_scan)
    check_pads(train, station)
    letters = chosen_letters(config, train.letters)
    learned = [name for name in letters if name not in config.hold_out]
    for name in learned:
        if name not in train.where("train").letters:
            raise unknown("letter of --train-scan", name, train.where("train").letters)
    fit(estimator, train.of_letters(tuple(learned)), forward_model)
    assert config.presses is not None
    assert config.trials != "all"  # which is of a scan
    own = {drawn.name: drawn for drawn in map(shape, config.shapes)}
    for name in own.keys() - set(letters):
        raise unknown("letter of --train-scan", name, letters)
    wanted = Wanted(letters, config.trials, config.readings, config.seed, own)
    if measure(station, wanted, config.presses, settings):
        return True
    count = len(wanted.letters) * wanted.trials * wanted.readings
    station.console.print(
        f"{count_measured(wanted, config.presses)} of {count} presses are measured; the same command with --presses "
        f"{config.presses} goes on"
    )
    return False
