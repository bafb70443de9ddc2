"""Where is kept what can be worked out again: the user's cache folder, or a temporary one. No result depends on it."""

from __future__ import annotations

import os
import stat
import tempfile
from contextlib import suppress
from pathlib import Path

FOLDER_VARIABLE = "TACTSIM_CACHE_DIR"


def cache_folder() -> Path:
    """Give the folder: TACTSIM_CACHE_DIR, or the user's cache folder of this system, or if need be a temporary one.

    The folder need not exist, and where not even the temporary one can be written it cannot be made: who keeps
    something does without then.
    """
    chosen = os.environ.get(FOLDER_VARIABLE)
    if chosen:
        return Path(chosen)
    from platformdirs import user_cache_path

    users = user_cache_path("tactsim", appauthor=False)
    # Without a home it is a relative path that begins with ~.
    return users if users.is_absolute() and can_be_written(users) else temporary_folder() or users


def can_be_written(folder: Path) -> bool:
    """Tell whether files can be made in a folder, or the folder itself; a full disk is not noticed."""
    with suppress(OSError):
        standing = next(one for one in (folder, *folder.absolute().parents) if one.exists())
        return standing.is_dir() and os.access(standing, os.W_OK | os.X_OK)
    return False


def temporary_folder() -> Path | None:
    """Make this user's folder among temporary files; None if it cannot be made, or is somebody else's.

    Compiled code is read from it, so nobody else may be able to put something there.
    """
    try:
        if not hasattr(os, "getuid"):  # Windows has a folder of temporary files for each user
            folder = Path(tempfile.gettempdir()) / "tactsim"
            folder.mkdir(exist_ok=True)
            return folder
        folder = Path(tempfile.gettempdir()) / f"tactsim-{os.getuid()}"
        folder.mkdir(mode=0o700, exist_ok=True)
        found = folder.lstat()
    except OSError:
        return None
    alone = stat.S_ISDIR(found.st_mode) and found.st_uid == os.getuid() and not found.st_mode & 0o022
    return folder if alone else None
