"""`bench watch` and `live`: a pad on the screen, and what it recognises as it touches."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import typer

from tactsim.bench.cli import pad_options as pads
from tactsim.bench.cli import shared_options as shared
from tactsim.bench.config import RunConfig
from tactsim.bench.console import plain_console

if TYPE_CHECKING:
    from tactsim.bench.trials import Progress
    from tactsim.core import Scan
    from tactsim.hardware.device import Device


def command_live(
    context: typer.Context,
    port: list[str] = typer.Option(
        ...,
        help="Where the pad is, as for `bench watch`. simulated:A hides an A, which is pressed where it is asked "
        "for. Repeat for a pad on several ports.",
    ),
    train_scan: Path | None = typer.Option(
        None, help="What the estimator learns from. Default: simulated presses of AEIOU on this pad."
    ),
    estimator: str = typer.Option(
        RunConfig.model_fields["estimator"].default, help="The estimator; `bench list` names them all."
    ),
    settings: list[str] | None = typer.Option(
        None, "--set", help="An option of the estimator, key=value; unknown=0.5 allows 'none'."
    ),
    explore: Literal["information", "random"] | None = typer.Option(
        None,
        help="The next touch: information (the estimator proposes it) or random. Default: information, if the "
        "estimator can.",
    ),
    readings: int | None = typer.Option(None, min=1, help="End after so many touches. Default: go on."),
    shapes: list[Path] | None = typer.Option(
        None,
        "--shape",
        help="A shape of your own, learned beside AEIOU; --port simulated:NAME of its file hides it.",
    ),
    device: pads.DeviceName = "emulated",
    calibration: pads.CalibrationFile = None,
    web: pads.Web = False,
    web_port: pads.WebPort = 8737,
    seen: shared.Seen = "behind",
    seed: shared.Seed = 0,
    as_json: bool = typer.Option(
        False,
        "--json",
        help="Print one JSON object for each touch on standard output and nothing else there.",
    ),
) -> None:
    """Recognise what is pressed, touch by touch; says which letter, where, and where to press next."""
    from contextlib import nullcontext

    import numpy as np

    from tactsim.bench.config import key_values
    from tactsim.bench.pad.simulated_hand import SimulatedHand, open_pressed
    from tactsim.bench.terminal import progress_bars
    from tactsim.bench.watching import PadReader
    from tactsim.bench.watching.belief_words import BeliefWords
    from tactsim.bench.watching.live_screen import live
    from tactsim.bench.watching.recogniser import Recogniser, on_taxels
    from tactsim.bench.watching.touch_leader import TouchLeader
    from tactsim.bench.watching.web import WebPage
    from tactsim.core import InputError
    from tactsim.core.provenance import poses_unknown
    from tactsim.estimators import create
    from tactsim.estimators.estimator import proposes_none
    from tactsim.estimators.likelihoods.occupancy import maps_of
    from tactsim.hardware.sources import taxels_of
    from tactsim.models import shape

    pads.refuse_without_page(context, web)
    described, correction = pads.load(device, calibration)
    made = create(estimator, **key_values(settings or (), "--set"))

    def asks() -> bool:
        if explore == "information" and not made.proposes:
            raise proposes_none(estimator)
        return made.proposes and explore != "random"

    asks()
    console = plain_console(stderr=as_json)
    opened, plan = open_pressed(port, described, correction, seed, list(map(shape, shapes or ())))
    # A pad speaks while the estimator learns.
    with opened as source, PadReader(source, described, " ".join(port)) as reader:
        with progress_bars() as progress:
            train = _training(train_scan, described, shapes or (), progress)
            learned_from = str(train_scan or "the simulation")
            train = on_taxels(train, source.taxel_xy, learned_from)
            if (unit := train.meta.get("unit", "kPa")) != source.unit:
                raise InputError(
                    f"{learned_from} is in {unit}, the pad reads {source.unit}; give a scan of this pad"
                )
            progress("map", 0, 1)
            recogniser = Recogniser.fitted(made, train, seed, np.array(plan.poses) if asks() else None)
            progress("map", 1, 1)
        ask = asks()  # what it learned from may tell no poses to choose among
        hand = source if isinstance(source, SimulatedHand) else None
        if poses_unknown(train.meta):
            whole = (
                "nobody knows the poses that it learned from: press all of the object, wherever it asks for"
            )
            plain_console(stderr=True).print(whole, soft_wrap=True)
        if hand is None and correction is None:
            untared = "no --calibration: if the pad never counts as lifted, `bench tare` makes one"
            plain_console(stderr=True).print(untared, soft_wrap=True)
        places = taxels_of(source)
        leading = TouchLeader(
            recogniser, plan, source.pad, "information" if ask else "random", seed, hand,
            lambda k: described.called(int(places[k])),
        )  # fmt: skip
        words = BeliefWords(leading, train, maps_of(made), source, seen == "behind")
        reader.on_reading, reader.on_tare = leading.take, leading.tared
        page = None
        if web:
            page = WebPage(
                reader, web_port, from_behind=seen == "behind", about=words.about(), more=words.event,
                commands=leading.commands(),
            )  # fmt: skip
        with page or nullcontext(), leading:
            url = None if page is None else page.url
            live(reader, words, console, readings=readings, as_json=as_json, page=url)
        reader.check()
        if leading.error is not None:
            raise leading.error


def _training(path: Path | None, device: Device, shapes: Sequence[Path], progress: Progress) -> Scan:
    """Load the training readings, or press them."""
    from tactsim.bench.formats import load_scan
    from tactsim.press import ScanOptions, scan_letters
    from tactsim.press.simulated_source import on_pad_of

    if path is not None:
        return load_scan(path)
    options = on_pad_of(device, ScanOptions(shapes=tuple(map(str, shapes))))
    return scan_letters(options, progress=lambda done, total: progress("press", done, total))[0]


def command_watch(
    context: typer.Context,
    port: pads.Port,
    device: pads.DeviceName = "emulated",
    calibration: pads.CalibrationFile = None,
    web: pads.Web = False,
    web_port: pads.WebPort = 8737,
    seen: shared.Seen = "behind",
    seconds: float | None = shared.number(
        "For how long. Default: till q, Ctrl-C or a recording's end.", default=None, least=0
    ),
) -> None:
    """Watch a pad: pressures, force, rate and what goes wrong; f freezes the picture, t takes a tare."""
    from contextlib import nullcontext

    from tactsim.bench.watching import PadReader
    from tactsim.bench.watching.watch_screen import watch
    from tactsim.bench.watching.web import WebPage
    from tactsim.hardware.sources import open_source

    pads.refuse_without_page(context, web)
    described, correction = pads.load(device, calibration)
    console = plain_console()
    with open_source(port, described) as opened:
        correction = None if correction == getattr(opened, "calibration", None) else correction
        source, played = pads.played(opened, described)
        reader = PadReader(source, played, " ".join(port), correction)
        page = WebPage(reader, web_port, from_behind=seen == "behind") if web else None
        with reader, page or nullcontext():
            url = None if page is None else page.url
            watch(reader, console, from_behind=seen == "behind", seconds=seconds, page=url)
        reader.check()
