"""The fence around a plug-in: what its process may take of the machine, and which files and doors stay shut.

It is a fence against mistakes and temptation. The limits are the operating system's. The rest is an audit hook: Python
itself reports what it is about to do, and what is not allowed is refused. Code in C that does not go through Python is
not seen. Whoever wants to break out of a process can; a container or another machine keeps that in.
"""

from __future__ import annotations

import errno
import os
import resource
import sys
import sysconfig
from collections.abc import Callable, Iterable
from importlib.util import find_spec
from pathlib import Path
from typing import Any

# What starts processes, ends them or talks to others: event of the audit hook, and what it is in words.
_SHUT = {
    **dict.fromkeys(("os.fork", "os.forkpty"), "start a process"),
    **dict.fromkeys(("os.exec", "os.posix_spawn", "os.spawn", "os.system", "pty.spawn"), "start a program"),
    "subprocess.Popen": "start a program",
    **dict.fromkeys(("os.kill", "os.killpg"), "send a signal"),
    **dict.fromkeys(("socket.connect", "socket.bind", "socket.sendto", "socket.sendmsg"), "use the network"),
    **dict.fromkeys(("socket.getaddrinfo", "socket.gethostbyname"), "use the network"),
    "resource.setrlimit": "change a limit",
}
# Events whose first argument is a path that is looked into, and those that change what is there.
_LOOKS = {
    "os.listdir": "listed",
    "os.scandir": "listed",
    "sqlite3.connect": "opened",
    "ctypes.dlopen": "loaded",
}
_CHANGES = (
    "os.remove", "os.rename", "os.rmdir", "os.mkdir", "os.truncate", "os.chmod", "os.chown", "os.link", "os.symlink",
    "os.utime", "os.setxattr", "os.removexattr", "os.chflags",
)  # fmt: skip
_CODE = (".py", ".pyc", ".so", ".dylib", ".pth")
# Of the system: none of them says anything of a trial.
_SYSTEM = (
    "/lib", "/lib64", "/usr/lib", "/usr/lib64", "/usr/local/lib", "/usr/share", "/System", "/Library", "/etc/fonts",
    "/etc/localtime", "/etc/timezone", "/etc/os-release", "/etc/mime.types", "/dev/null", "/dev/urandom", "/dev/random",
    "/proc/cpuinfo", "/proc/meminfo", "/proc/stat", "/proc/sys/kernel", "/proc/sys/vm", "/sys/devices/system",
    "/sys/fs/cgroup",
)  # fmt: skip


class Refused(PermissionError):
    """A plug-in was about to do what the fence does not allow."""


def limit(memory_mb: int) -> None:
    """Limit this process: so much memory more than it takes now, no core dump, no file above 1 GB.

    macOS does not keep the limit of memory; `over` tells afterwards.
    """
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    resource.setrlimit(resource.RLIMIT_FSIZE, (10**9, 10**9))
    pages = Path("/proc/self/statm")
    if pages.exists():
        taken = int(pages.read_text(encoding="ascii").split()[0]) * resource.getpagesize()
        most = taken + memory_mb * 1_000_000
        resource.setrlimit(resource.RLIMIT_AS, (most, most))


def build(own: Path, package: str, tell: Callable[[str], None]) -> None:
    """Put up the fence for the rest of this process's life; it cannot be taken down.

    own: the process's private folder, where it may do as it likes. package: the plug-in's, whose files it may read.
    tell(what) is called for a look at what is not the plug-in's business, and must end the process.
    """
    sys.addaudithook(_Fence(own, package, tell))


class _Fence:
    def __init__(self, own: Path, package: str, tell: Callable[[str], None]) -> None:
        self._tell = tell
        self._own = _real([own])
        of_python = [sysconfig.get_path(name) for name in ("stdlib", "platstdlib", "purelib", "platlib")]
        site = [place for place in sys.path if Path(place).name in ("site-packages", "dist-packages")]
        # In a checkout the rooms lie beside `tactsim` and are linked into it.
        rooms = [str(room) for place in _package("tactsim") for room in (place, *Path(place).glob("*"))]
        self._libraries = _real(
            [*of_python, *site, *_SYSTEM, *rooms, *_package(package), f"/proc/{os.getpid()}"]
        )
        self._path = _real(place for place in sys.path if place)
        self._known: dict[str, bool] = {}

    def __call__(self, event: str, arguments: tuple[Any, ...]) -> None:
        if event == "open":
            self._open(*arguments)
        elif event in _SHUT:
            raise Refused(errno.EPERM, f"a plug-in may not {_SHUT[event]} ({event})")
        elif event in _LOOKS:
            self._look(_LOOKS[event], arguments[0])
        elif event in _CHANGES:
            for path in arguments[: 2 if event in ("os.rename", "os.link", "os.symlink") else 1]:
                self._change(path)

    def _open(self, path: Any, mode: Any, flags: Any) -> None:
        writes = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND
        if flags & writes and path != "/dev/null":
            self._change(path)
        else:
            self._look("opened", path)

    def _look(self, did: str, path: Any) -> None:
        if path is None or isinstance(path, int) or path in ("", b""):
            return  # what is open already; the working folder, which is the plug-in's own
        name = os.fsdecode(path)
        if did == "loaded" and "/" not in name:
            return  # a library of the system
        if name not in self._known:
            real = os.path.realpath(name)
            self._known[name] = (
                _within(real, self._own)
                or _within(real, self._libraries)
                or (_within(real, self._path) and (_is_code(real) or Path(real).is_dir()))
            )
        # Libraries look for many files that are not there.
        if not self._known[name] and os.path.lexists(name):
            self._tell(f"{did} {name}")

    def _change(self, path: Any) -> None:
        if isinstance(path, int):
            return
        if not _within(os.path.realpath(os.fsdecode(path)), self._own):
            # Caches beside a library try, and do without.
            raise Refused(errno.EACCES, f"a plug-in may not write {os.fsdecode(path)}")


def _real(places: Iterable[str | Path]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(os.path.realpath(place) for place in places))


def _within(path: str, folders: Iterable[str]) -> bool:
    return any(path == folder or path.startswith(folder.rstrip("/") + "/") for folder in folders)


def _is_code(path: str) -> bool:
    """Tell whether a file is there to be imported, or says what is installed."""
    return path.endswith(_CODE) or Path(path).parent.suffix in (".dist-info", ".egg-info")


def _package(name: str) -> list[str]:
    """Name the folders of an installed package, or the file of a module that is in none; nothing is imported."""
    try:
        spec = find_spec(name.partition(".")[0])
    except (ImportError, ValueError):
        return []
    if spec is None:
        return []
    return list(spec.submodule_search_locations or filter(None, [spec.origin]))
