"""The guided session as a person sees it: on a real terminal of 80 x 24, with a pad that is lost and comes back."""

import io

import numpy as np
import pytest
from command_line import emulated
from rich.console import Console
from rich.live import Live
from terminal import Screen as Terminal

from tactsim.bench.pad.guided import Screen
from tactsim.bench.watching import PadView
from tactsim.core.pad import Pad
from tactsim.hardware.recording import Kind, RecordReader
from tactsim.hardware.scans import read_session
from tactsim.hardware.session import Plan, Session


def whole(screen):
    """Nothing was too long for its line, or moved out at the top."""
    return screen.wrapped == 0 and screen.scrolled == 0


@pytest.mark.long
def test_the_guide_fits_a_terminal_and_outlives_a_lost_pad(bench, on_terminal, tmp_path):
    words = [
        "record", "--port", "pad", "--letter", "A", "--out", "A.npz", "--poses", "random:3", "--frames", "5",
    ]  # fmt: skip
    hand = ["--follow", "A.tactrec", "--rate", "200", "--lift", "0.5", "--scan-set", "sensor.noise=0.2"]
    with emulated(bench, "--port", "pty:pad", *hand):
        terminal = on_terminal(*words)
        screen = terminal.until(
            lambda screen: "the last press that was taken" in screen.text and "1 done" in screen.text
        )
        shown = screen.lines
    lost = terminal.until(
        lambda screen: "THE PAD IS LOST" in screen.text and "there is no such port" in screen.text
    ).lines
    with emulated(bench, "--port", "pty:pad", *hand):
        terminal.until(lambda screen: "THE PAD IS LOST" not in screen.text and "press" in screen.text)
        assert terminal.ended() == 0
    assert "3 readings of A in A.npz" in terminal.screen.text
    assert whole(terminal.screen)
    assert "press 2 of 3, 1 done" in shown[0]
    assert not any(character.isdigit() for line in lost[3:9] for character in line[39:])
    kinds = [record.kind for record in RecordReader(tmp_path / "A.tactrec")]
    assert Kind.LOST in kinds


@pytest.mark.long
def test_a_zero_that_falls_is_said_and_a_key_takes_a_tare(bench, here, on_terminal, tmp_path):
    with emulated(bench, "--port", "pty:pad", "--drift", "-0.5"):
        assert here("tare", "--port", "pad", "--out", "tare.toml").returncode == 0
        terminal = on_terminal(
            "record", "--port", "pad", "--letter", "A", "--out", "A.npz", "--calibration", "tare.toml"
        )
        terminal.until(lambda screen: "zero has moved" in screen.text)
        terminal.press("t")
        terminal.until(lambda screen: "tared, from 100 readings" in screen.text)
        terminal.press("q")
        assert terminal.ended() == 0
    session = read_session(tmp_path / "A.tactrec")
    first, taken = (calibration.tare for _, calibration in session.calibrations)
    assert np.subtract(taken, first).max() < -1
    assert session.calibrations[1][0] > 100


@pytest.mark.long
def test_the_guide_ends_when_its_terminal_is_closed(bench, on_terminal, tmp_path):
    with emulated(bench, "--port", "pty:pad"):
        terminal = on_terminal("record", "--port", "pad", "--letter", "A", "--out", "A.npz")
        terminal.until(lambda screen: "lift it off" in screen.text)
        terminal.close()
        terminal.process.wait(20)
    assert list(RecordReader(tmp_path / "A.tactrec"))


@pytest.mark.parametrize(
    ("rows", "columns", "pitch", "size"),
    [
        (1, 1, 5.0, (80, 24)),
        (6, 6, 1.9, (80, 24)),
        (64, 64, 1.0, (80, 24)),
        (6, 6, 1.9, (60, 30)),
        (6, 6, 1.9, (40, 40)),
    ],
)
@pytest.mark.parametrize("lost", [False, True])
def test_the_picture_fits_the_terminal_and_no_word_is_cut(rows, columns, pitch, size, lost):
    pad = Pad(rows=rows, columns=columns, pitch_x=pitch, pitch_y=pitch, taxel_width=pitch - 0.1,
              taxel_height=pitch - 0.1, seam=None, unread_columns=0)  # fmt: skip
    plan = Plan(label="shape-with-a-name", poses=((-11.6, -10.4, np.deg2rad(328.6)),) * 192, enough=150)
    session = Session(plan, pad)
    session.image = np.linspace(-3, 1234, pad.taxels)
    session.message = "taxel 511 still reads 1234.5 kPa; lift everything off, or take a tare"
    file = io.StringIO()
    width, height = size
    console = Console(file=file, width=width, height=height, force_terminal=True, color_system="truecolor")
    screen = Screen(session, True, console, "trial 100 of 200: ")
    port = "/dev/serial/by-id/usb-Arduino_LLC_Arduino_Leonardo-if00"
    trouble = f"nothing came within 0.5 s: cannot open {port}: no such port; `x`"
    view = PadView(state="live", pressures=session.image, force=12.0)
    shown = Terminal(width, height)
    with Live(console=console, auto_refresh=False, screen=True) as live:
        live.update(screen.draw(PadView(state="lost", trouble=trouble) if lost else view), refresh=True)
        shown.feed(file.getvalue().replace("\n", "\r\n").encode())
    assert whole(shown)
    said = "".join(shown.text.split())  # a word longer than a line is broken
    for words in (
        "trial 100 of 200: shape-with-a-name (train), press 1 of 150 template: x -11.6, y -10.4, arrow at",
        f"cannot open {port}: no such port; `x`" if lost else session.message,
        "space take it as it is r redo the last s skip t tare q stop for now",
    ):
        assert words.replace(" ", "") in said
    assert {"the", "last", "press", "that", "was", "taken"} <= set(shown.text.split())
    assert ("THE PAD IS LOST" in shown.text) == lost
