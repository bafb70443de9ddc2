"""`bench data`: list public recordings of real pads, and make a scan of one."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from tactsim.bench.cli import shared_options as shared

if TYPE_CHECKING:
    from tactsim.bench.formats.public_recordings import Recording


def command(
    action: Annotated[
        str | None, typer.Argument(metavar="[get]", help="Download, check and import one.")
    ] = None,
    name: Annotated[str | None, typer.Argument(metavar="[NAME]", help="Which one.")] = None,
    source: Annotated[
        Path | None,
        typer.Option("--from", help="Download nothing: the file, or the folder that holds the files."),
    ] = None,
    out: Annotated[Path | None, typer.Option(help="The scan to write. [default: NAME.npz]")] = None,
    as_json: shared.AsJson = False,
) -> None:
    """List public recordings of real pads, or `get` one: download, check and import it as a scan."""
    import json

    from tactsim.bench.console import kept_clear, plain_console
    from tactsim.bench.formats import public_recordings as public
    from tactsim.bench.places import check_new_file
    from tactsim.core import InputError

    if action is None:
        if source is not None or out is not None:
            raise InputError("--from and --out are of `bench data get NAME`")
        known = public.recordings()
        if as_json:
            typer.echo(json.dumps({name: one.model_dump(mode="json") for name, one in known.items()}))
            return
        for name, recording in known.items():
            plain_console().print("\n".join([name, *_lines(recording)]), soft_wrap=True)
        return
    if action != "get" or name is None:
        raise InputError(f"bench data {action}: give `bench data`, or `bench data get NAME`")
    recording = public.known_recording(name)
    out = Path(f"{name}.npz") if out is None else out
    check_new_file(out, source, suffix=".npz")
    with kept_clear(as_json):
        scan = public.scan_of(recording, public.files_of(name, recording, source))
        scan.save(out)
    if as_json:
        typer.echo(json.dumps({"scan": str(out), "readings": len(scan), "letters": scan.letters}))
        return
    plain_console().print(
        f"{len(scan):,} readings of {' '.join(scan.letters)}, {scan.readings.shape[1]} taxels, in {out}\n"
        f"terms     {recording.terms}\ncite      {recording.citation}",
        soft_wrap=True,
    )


def _lines(recording: Recording) -> list[str]:
    files = len(recording.files)
    return [
        f"  what      {recording.what}",
        f"  size      {recording.size / 1e6:.1f} MB in {files} file{'s' * (files > 1)}, each with its SHA-256 (--json)",
        f"  licence   {recording.licence or 'none stated'}; {recording.terms}",
        f"  cite      {recording.citation}",
        f"  address   {recording.repository} at commit {recording.commit}",
        f"  unsaid    {recording.unverified}; poses: {recording.poses}",
    ]
