"""A harness for comparing ways to recognise an object by touch; what is imported is this package alone.

    import tactsim

    scan = tactsim.scan(letters="AEIOU")
    run = tactsim.run(scan, estimator="refined", trials=20, readings=10)
    run.accuracy[4]  # share of the trials that are right after five readings

Packages, each importing only those before it: `core`, `models`, `press`, `estimators` and `hardware`, `bench`, `env`,
which is an extra; and beside them `attach`, taxels on anybody's MuJoCo model.
Everything is imported when it is first used.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tactsim import bench, core, estimators, hardware, models
    from tactsim.bench.api import compare, run, scan, submit, sweep
    from tactsim.bench.results import Run
    from tactsim.core import InputError, Pad, Scan, compose, invert, transform, wrap_angle
    from tactsim.estimators import Estimate, Estimator, create
    from tactsim.press import (
        WORLDS,
        CallablePackage,
        Press,
        PressOptions,
        ScanOptions,
        SensorOptions,
        press_letter,
        scan_letters,
    )

    __version__: str
    press: CallablePackage

_HOME = {
    "core": ("InputError", "Pad", "Scan", "compose", "invert", "transform", "wrap_angle"),
    "press": (
        "WORLDS",
        "Press",
        "PressOptions",
        "ScanOptions",
        "SensorOptions",
        "press_letter",
        "scan_letters",
    ),
    "estimators": ("Estimate", "Estimator", "create"),
    "bench.api": ("compare", "run", "scan", "submit", "sweep"),
    "bench.results": ("Run",),
}
_MODULE_OF = {name: module for module, names in _HOME.items() for name in names}
_ROOMS = ("attach", "bench", "core", "env", "estimators", "hardware", "models", "press")

__all__ = [
    "WORLDS",
    "Estimate",
    "Estimator",
    "InputError",
    "Pad",
    "Press",
    "PressOptions",
    "Run",
    "Scan",
    "ScanOptions",
    "SensorOptions",
    "__version__",
    "bench",
    "compare",
    "compose",
    "core",
    "create",
    "estimators",
    "hardware",
    "invert",
    "models",
    "press",
    "press_letter",
    "run",
    "scan",
    "scan_letters",
    "submit",
    "sweep",
    "transform",
    "wrap_angle",
]


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib.metadata import version

        return version("tactsim")
    if name in _ROOMS:
        return import_module(f"{__name__}.{name}")
    if name not in _MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_MODULE_OF[name]}"), name)


def __dir__() -> list[str]:
    return __all__
