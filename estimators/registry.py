"""Find estimators by name: the built-in ones and those of installed packages."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, cast

from tactsim.core.checking import checked
from tactsim.core.errors import InputError, short, some
from tactsim.core.plug_ins import Registry, fault_of_class
from tactsim.estimators.estimator import Estimator, Options, check_options, no_exit
from tactsim.estimators.likelihoods.likelihood import kind_of
from tactsim.estimators.options import LikelihoodOptions, joined

GROUP = "tactsim.estimators"

# name: (where its class is, what it is), in the order in which `bench list` shows them. Nothing is
# imported before its name is asked for.
BUILT_IN: dict[str, tuple[str, str]] = {
    "histogram": (
        "tactsim.estimators.filters.histogram:HistogramFilter",
        "histogram filter, the paper's eq. 13 to 16",
    ),
    "particle": (
        "tactsim.estimators.filters.particle:ParticleFilter",
        "particle filter, the paper's eq. 8 to 12",
    ),
    "augmented-mcl": (
        "tactsim.estimators.filters.particle:AugmentedFilter",
        "particle filter that injects random particles",
    ),
    "stacked": (
        "tactsim.estimators.stacked_filter:StackedFilter",
        "the default: coarse-to-fine on pressures and their shares, still or moving; by images where no pose is known",
    ),
    "refined": (
        "tactsim.estimators.filters.refined:RefinedFilter",
        "coarse-to-fine histogram: the best bins are halved again",
    ),
    "force-mosaic": (
        "tactsim.estimators.filters.refined:ForceMosaicFilter",
        "coarse-to-fine on predicted pressures instead of classes",
    ),
    "synthesis": (
        "tactsim.estimators.synthesis.synthesis:Synthesis",
        "analysis by synthesis: presses the known letters itself",
    ),
    "graded": (
        "tactsim.estimators.filters.refined:GradedFilter",
        "coarse-to-fine on shares of the reading's own pressure, for loads that vary",
    ),
    "nearest": (
        "tactsim.estimators.baselines.nearest:Nearest",
        "baseline without maps: which training readings are alike",
    ),
    "bag-of-features": (
        "tactsim.estimators.baselines.nearest:BagOfFeatures",
        "baseline without poses: how often a letter gives each kind of reading",
    ),
    "whole-image": (
        "tactsim.estimators.baselines.whole_image:WholeImage",
        "baseline without poses: images of whole presses, as they lie or whatever their turn, and a kernel machine",
    ),
    "space-refined": (
        "tactsim.solids.refined:SpaceRefinedFilter",
        "objects in space: coarse-to-fine over cells of poses, then particles",
    ),
}

# Estimators that were given up, and what to take instead.
_GIVEN_UP = {
    "tempered": "take refined, which is better in every figure",
    "scan-matching": "take refined, which is better in every figure",
    "space-tempered": "take space-refined",
    "spectrum": "take whole-image, which also tells mirror images apart",
    "mlp": "install the plug-in examples/mlp, which brings it",
}

_ONE_NUMBER = "particles is their number, always"
_GIVEN_UP_OPTIONS = {
    "moments": "several images of one touch told objects apart no sooner than the last; train on several loads",
    **dict.fromkeys(("kld_error", "kld_z", "kld_mm", "kld_rad", "min_particles"), _ONE_NUMBER),
}


def _fault(found: Any) -> str | None:
    return fault_of_class(found, Estimator, "estimators.Estimator", Options)


_ESTIMATORS = Registry("estimator", GROUP, BUILT_IN, _fault)
names, listing = _ESTIMATORS.names, _ESTIMATORS.listing


def create(name: str, **options: Any) -> Estimator:
    """Make the estimator of that name with these options.

    Raises InputError for an unknown name, a broken plug-in, or an option that is unknown or out of its bounds.
    """
    kind = load(name)
    taken = options_of(name, options)
    for option in options:
        if option in _GIVEN_UP_OPTIONS and option not in taken.model_fields:
            raise InputError(f"estimator {name}: there is no option {option}: {_GIVEN_UP_OPTIONS[option]}")
    asked = checked(taken, options, f"estimator {name}")
    with no_exit(name):
        made = kind(asked)
    check_options(made, name)
    made.created_as = name
    return made


def options_of(name: str, given: Mapping[str, Any] | None = None) -> type[Options]:
    """Give the options of an estimator: its own, and those of the measurement model that is given, or it has.

    Raises InputError for an unknown estimator or measurement model.
    """
    own = load(name).options_type
    if not issubclass(own, LikelihoodOptions):
        return own
    model = (given or {}).get("likelihood", own.model_fields["likelihood"].default)
    return joined(own, kind_of(model).options_type) if isinstance(model, str) else own


def load(name: str) -> type[Estimator]:
    """Import the class of that name. Raises InputError if there is none or it is no Estimator."""
    if not isinstance(name, str):
        raise InputError(f"estimator {short(name)}: give a name, one of {some(names())}")
    if name in _GIVEN_UP and name not in names():
        raise InputError(f"estimator {name} is no longer built in: {_GIVEN_UP[name]}")
    return cast("type[Estimator]", _ESTIMATORS.load(name))
