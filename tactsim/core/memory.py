"""How much memory there is, and the refusal of what would not fit."""

from __future__ import annotations

from pathlib import Path

from tactsim.core.errors import InputError

_GB = 1e9
_SMALL = 64e6  # bytes that no machine lacks: less is not asked for


def require(needed: float, what: str, remedy: str) -> None:
    """Raise InputError if `needed` bytes are more than what is free.

    what: what they are for, such as "36 letters with 1,000,000 bins each". remedy: what to choose instead.
    """
    if needed < _SMALL:
        return
    free = free_memory()
    if needed > free:
        raise InputError(
            f"{what} would take about {needed / _GB:.1f} GB of memory, and {free / _GB:.1f} GB are free; {remedy}"
        )


def free_memory() -> float:
    """Give the bytes that this process may still take: of the machine, its control group and its own limit.

    Infinite where the system does not say.
    """
    found = [_available(), _of_group(), _of_limit()]
    return max(0.0, min(found))


def _available() -> float:
    for line in _text(Path("/proc/meminfo")).splitlines():
        if line.startswith("MemAvailable:"):
            return float(line.split()[1]) * 1024
    return float("inf")


def _of_group() -> float:
    folder = Path("/sys/fs/cgroup")
    most, used = _text(folder / "memory.max").strip(), _text(folder / "memory.current").strip()
    return float(most) - float(used) if most.isdigit() and used.isdigit() else float("inf")


def _of_limit() -> float:
    try:
        import resource
    except ImportError:  # Windows knows no such limit
        return float("inf")
    most = resource.getrlimit(resource.RLIMIT_AS)[0]
    pages = _text(Path("/proc/self/statm")).split()
    if most == resource.RLIM_INFINITY or not pages:
        return float("inf")
    return most - float(pages[0]) * resource.getpagesize()


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="ascii")
    except OSError:
        return ""
