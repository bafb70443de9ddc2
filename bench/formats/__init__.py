"""Data that travels: the file formats that a scan or the trials of a run can be written in, and read from.

    from tactsim.bench import formats

    formats.write(scan, "letters", "parquet")  # a folder as Hugging Face lays it out
    formats.read("letters").digest == scan.digest

One file for each format; `FORMATS` is the one table that chooses among them. A format's library is an extra and is
imported when the format is first used.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tactsim.bench.config import RECORDING
from tactsim.bench.placement import stated_properties
from tactsim.core import InputError, Scan
from tactsim.core.errors import unknown
from tactsim.core.files import new_folder, replacing
from tactsim.core.making import from_recording

if TYPE_CHECKING:
    from tactsim.bench.results import Run


@dataclass(frozen=True)
class Format:
    """One row of `FORMATS`.

    line: what it is for. library: what has to be installed, by the extra `name`. module: the file of this package
    that has `write_scan`, `read_scan` and `write_run`. suffixes: of its files; none if it is a folder.
    """

    name: str
    line: str
    library: str
    module: str
    suffixes: tuple[str, ...] = ()

    def load(self) -> Any:
        """Import the file of this format. Raises InputError if its library is not installed."""
        try:
            import_module(self.library)
        except ImportError as error:
            raise InputError(
                f"{self.name} needs the library {self.library.partition('.')[0]} ({error}): "
                f"pip install 'tactsim[{self.name}]'"
            ) from error
        return import_module(f"{__name__}.{self.module}")


_PARQUET = Format("parquet", "a folder with a card, as Hugging Face has it", "pyarrow", "parquet_folder")
_HDF5 = Format("hdf5", "one file with every array and its unit", "h5py", "hdf5_file", (".h5", ".hdf5"))
FORMATS = {one.name: one for one in (_PARQUET, _HDF5)}


def find(name: str) -> Format:
    """Look a format up by its name. Raises InputError for an unknown one."""
    if name == "mcap":
        raise InputError("the format mcap is gone; take hdf5, one file with every array and its unit")
    if name not in FORMATS:
        raise unknown("format", name, [*FORMATS, "csv"])
    return FORMATS[name]


def guess(path: str | Path) -> Format:
    """Tell by its name in which format a file is. Raises InputError if none fits."""
    place = Path(path)
    for one in FORMATS.values():
        if place.suffix.lower() in one.suffixes or (place.is_dir() and not one.suffixes):
            return one
    if place.suffix == ".tactrec":
        raise InputError(f"{path} is a recording; make a scan of it with {from_recording(path)}")
    known = [suffix for one in FORMATS.values() for suffix in one.suffixes]
    raise InputError(
        f"{path}: no format has such files; known are {', '.join(known)} and a folder of Parquet as `bench export` "
        "writes them, readings, poses and labels together in a .npz (numpy.savez), .mat or .h5 file, and a press a row "
        "in a .csv file; of frames name the folder, with a press a file"
    )


def write(what: Scan | Run, path: str | Path, name: str) -> None:
    """Write a scan, or the trials of a run, in the format of that name: a new folder or a file, whole or not at all.

    The same scan gives the same bytes with the same version of the format's library.

    Raises InputError for an unknown format, a missing library, a folder that
    holds something, a file of another ending and a place that cannot be written.
    """
    form = find(name)
    if isinstance(what, Scan) and not len(what):
        raise InputError("the scan holds no readings, so there is nothing to export")
    if form.suffixes and Path(path).suffix.lower() not in form.suffixes:
        raise InputError(f"{path}: a file of {name} has a name that ends in {' or '.join(form.suffixes)}")
    module = form.load()
    write_it = module.write_scan if isinstance(what, Scan) else module.write_run
    if form.suffixes:
        with replacing(path) as stream:
            write_it(what, stream)
    else:
        with new_folder(path) as folder:
            write_it(what, folder)


def read(path: str | Path, name: str | None = None) -> Scan:
    """Read a scan that `write` wrote; nothing in it is unpickled or run, and what it claims is checked first.

    name: the format; None to tell it from the path. Raises InputError if the file is missing, not whole, of another
    kind or larger than a scan may be, and if the format's library is missing.
    """
    form = guess(path) if name is None else find(name)
    module = form.load()
    try:
        scan = module.read_scan(Path(path))
    except InputError as error:
        raise InputError(f"cannot read {path} as {form.name}: {error}") from error
    assert isinstance(scan, Scan)
    return scan


def is_of_a_run() -> InputError:
    """Build the error for an export of a run where one of a scan is wanted."""
    return InputError(
        "it holds the trials of a run, which keeps its estimates, not its readings; give an export of a scan"
    )


def load_scan(path: str | Path, seed: int = 0) -> Scan:
    """Load a scan for trials: one whose objects can be scored, from a file, or `recording:NAME` of a public recording.

    seed: of the run. Raises InputError that names the file.
    """
    if str(path).startswith(RECORDING):
        from tactsim.bench.formats.public_recordings import prepared_scan  # few runs need it

        return prepared_scan(str(path).removeprefix(RECORDING), seed)
    scan = Scan.load(path)
    try:
        stated_properties(scan)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    return scan
