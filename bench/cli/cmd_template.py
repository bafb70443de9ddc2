"""`bench template`: sheets to print, by which a letter is put on the pad by hand."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from tactsim.bench.cli import guide_options as guide
from tactsim.bench.cli import pad_options as pads


def command(
    out: Annotated[Path, typer.Option(help="The file to write, .pdf.")],
    letters: Annotated[str, typer.Option(help="Which letters: AEIOU, A-Z0-9, A,E,I.")] = "AEIOU",
    shape: Annotated[
        list[Path] | None, typer.Option(help="A shape of your own beside the letters; repeat for several.")
    ] = None,
    device: pads.DeviceName = "emulated",
    seen: guide.Seen = "behind",
    paper: Annotated[str, typer.Option(help="The paper: a4 or letter.")] = "a4",
) -> None:
    """Print the pad's sheet and one for each letter, 1:1, with the positions and angles of the scan."""
    from tactsim.bench.config import scan_options
    from tactsim.bench.console import plain_console
    from tactsim.bench.pad.template import PAPERS, Sheets, as_pdf, draw_sheets
    from tactsim.bench.places import check_new_file
    from tactsim.core.errors import InputError
    from tactsim.core.files import write_bytes
    from tactsim.hardware.device import load_device
    from tactsim.press.scanning import letters_of

    if paper not in PAPERS:
        raise InputError(f"--paper {paper!r}: say {' or '.join(PAPERS)}")
    check_new_file(out, picture=".pdf")
    sheets = Sheets(paper, load_device(device).pad, seen == "behind")
    pressed = letters_of(scan_options(letters=letters, shapes=shape or ()))
    write_bytes(out, as_pdf(draw_sheets(pressed, sheets)))
    plain_console().print(
        f"{1 + len(pressed)} pages in {out}: the pad's sheet, then {' '.join(letter.name for letter in pressed)}; "
        "print at 100 % and check the rulers"
    )
