"""What `bench new` makes: a repository of a user's own, for an estimator, a measurement model or a source.

The files that it is made from stand beside this one, each with `.txt` behind its name. In them the new name is
`your-name`, `your_name` and `YourName`, so that they are files as they will be.
"""

from __future__ import annotations

import keyword
import re
from collections.abc import Mapping
from importlib.metadata import version
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path

from jinja2 import Environment

from tactsim.bench.places import check_new_folder
from tactsim.core import InputError
from tactsim.core.errors import short, unknown
from tactsim.core.files import new_folder

KINDS = ("estimator", "likelihood", "source")
_LONGEST = 40  # characters of a name: it is part of lines of code
_SHARED = {
    "LICENSE": "shared/LICENSE.txt",
    ".gitignore": "shared/gitignore.txt",
    "pyproject.toml": "shared/pyproject.toml.txt",
    "src/your_name/__init__.py": "shared/__init__.py.txt",
    ".github/workflows/test.yml": "shared/workflow.yml.txt",
}
# A line of a template that begins with #% is a statement of Jinja2, such as `if kind == "source"`.
_TEMPLATES = Environment(
    line_statement_prefix="#%",
    variable_start_string="<<",  # a workflow has braces of its own
    variable_end_string=">>",
    keep_trailing_newline=True,
)

_LISTED = {
    "estimator": "`bench list`",
    "likelihood": "`bench list likelihoods`",
    "source": "`bench devices`",
}

# For each kind what is in the new repository, and the file here that it is made from.
FILES: Mapping[str, Mapping[str, str]] = {
    "estimator": _SHARED
    | {
        "README.md": "estimator/README.md.txt",
        "src/your_name/estimator.py": "estimator/estimator.py.txt",
        "tests/test_your_name.py": "estimator/test_estimator.py.txt",
    },
    "likelihood": _SHARED
    | {
        "README.md": "likelihood/README.md.txt",
        "src/your_name/likelihood.py": "likelihood/likelihood.py.txt",
        "tests/test_your_name.py": "likelihood/test_likelihood.py.txt",
    },
    "source": _SHARED
    | {
        "README.md": "source/README.md.txt",
        "pad.toml": "source/pad.toml.txt",
        "touches.csv": "source/touches.csv.txt",
        "src/your_name/source.py": "source/source.py.txt",
        "tests/test_your_name.py": "source/test_source.py.txt",
    },
}


def make(kind: str, name: str, folder: Path | None = None) -> Path:
    """Make a repository of one of `KINDS` called `name`; gives its folder.

    folder: a new or an empty one; None for one in the current folder, called as the repository. Nothing is
    half-written: the folder is there when all its files are.

    Raises InputError for an unknown kind, a name that cannot be used or is taken, and a folder that holds something.
    """
    if kind == "task":
        raise InputError("a task is one TOML file and needs no repository: docs/tasks.md shows one")
    if kind not in KINDS:
        raise unknown("thing to make", kind, KINDS)
    name = checked_name(kind, name)
    folder = Path(name) if folder is None else folder
    check_new_folder(folder)
    with new_folder(folder) as made:
        for path, text in contents(kind, name).items():
            target = made / path
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_text(text, encoding="utf-8")
    return folder


def contents(kind: str, name: str) -> dict[str, str]:
    """Give the text of every file of a repository, by its path in it."""
    here = files("tactsim.bench.new")
    return {
        _named(path, name): _named(
            _TEMPLATES.from_string((here / source).read_text(encoding="utf-8")).render(kind=kind), name
        )
        for path, source in FILES[kind].items()
    }


def _named(text: str, name: str) -> str:
    words = {
        "your-name": name,
        "your_name": name.replace("-", "_"),
        "YourName": "".join(word.capitalize() for word in name.split("-")),
        "TACTSIM_VERSION": version("tactsim"),
    }
    for placeholder, word in words.items():
        text = text.replace(placeholder, word)
    return text


def checked_name(kind: str, name: str) -> str:
    """Give the name in lower-case words joined by hyphens. Raises InputError if it cannot be used or is taken."""
    given, name = name, name.replace("_", "-")
    package = name.replace("-", "_")
    if not re.fullmatch(r"[a-z][a-z0-9]*(-[a-z0-9]+)*", name) or len(name) > _LONGEST:
        raise InputError(
            f"{kind} {short(given)}: a name is lower-case words with hyphens between them, such as my-{kind}, "
            f"begins with a letter and has at most {_LONGEST} characters"
        )
    if name in _taken(kind):
        raise InputError(f"{kind} {name!r}: there is one of that name already; {_LISTED[kind]} shows it")
    if keyword.iskeyword(package):
        raise InputError(f"{kind} {name!r}: that is a word of Python; call it my-{name}, for example")
    installed = find_spec(package)
    if installed is not None:
        raise InputError(
            f"{kind} {name!r}: a Python package {package} is installed already ({installed.origin}), and one would "
            f"hide the other; call it my-{name}, for example"
        )
    return name


def _taken(kind: str) -> tuple[str, ...]:
    """List the names of a kind that are in use."""
    if kind == "estimator":
        from tactsim.estimators import names as estimators

        return estimators()
    if kind == "likelihood":
        from tactsim.estimators.likelihoods.likelihood import names as likelihoods

        return likelihoods()
    from tactsim.hardware.sources import names as sources

    return sources()
