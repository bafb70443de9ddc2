"""`TrialPlan`: all that a worker needs to do trials, and what identifies their result."""

from __future__ import annotations

import hashlib
import json
import pickle
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

from tactsim.bench.fitting import fit
from tactsim.bench.offered_touches import Press
from tactsim.bench.slip import STILL, Slip
from tactsim.bench.trials import Explore
from tactsim.core import InputError, Scan
from tactsim.core.forward import ForwardModel
from tactsim.core.source_digest import source_digest
from tactsim.estimators import Estimator, create
from tactsim.estimators.registry import load


@dataclass(frozen=True, eq=False)
class TrialPlan:
    """All that a worker needs to do trials: the estimator, the scan, and how many readings in which order.

    press: what presses on demand; None if the readings are those of the scan. forward: what makes the forward model of
    a scan, for an estimator that asks for one. given: an estimator made in Python, as
    it is or pickled for a worker; None if `estimator` is a registered name. each_held_out: whether the letter of a
    trial is left out of what the estimator knows.
    """

    estimator: str
    options: Mapping[str, Any]
    scan: Scan
    readings: int
    seed: int
    explore: Explore = "random"
    slip: Slip = STILL
    press: Press | None = None
    forward: Callable[[Scan], ForwardModel] | None = None
    given: Estimator | bytes | None = None
    each_held_out: bool = False

    def letters_known(self, truth: str) -> tuple[str, ...]:
        """List the letters that an estimator knows in the trials of the letter `truth`."""
        trained = self.scan.where("train").letters
        return tuple(letter for letter in trained if not (self.each_held_out and letter == truth))

    def fitted_for(self, truth: str, estimator: Estimator) -> Estimator:
        """Give what the trials of a letter need: the fitted `estimator`, without the letter if each is held out."""
        return estimator.without(truth, self.scan) if self.each_held_out else estimator

    def make(self) -> Estimator:
        """Make the estimator, which is not fitted yet.

        Raises InputError if it does not exist, or was given and cannot be made in another process.
        """
        if self.given is None:
            return create(self.estimator, **self.options)
        if not isinstance(self.given, bytes):
            return self.given
        try:
            return pickle.loads(self.given)
        except Exception as error:  # a user's class may raise anything when it is unpickled
            raise _not_portable(self.estimator, error) from error

    def fitted(self) -> Estimator:
        """Make the estimator and fit it. Raises InputError as `make` and `fit` do."""
        estimator = self.make()
        fit(estimator, self.scan, self.forward)
        return estimator

    def portable(self) -> TrialPlan:
        """Return a plan that can be sent to worker processes. Raises InputError if the estimator cannot be."""
        if self.given is None or isinstance(self.given, bytes):
            return self
        try:
            return replace(self, given=pickle.dumps(self.given))
        except Exception as error:  # a user's class may raise anything when it is pickled
            raise _not_portable(self.estimator, error) from error

    @property
    def source(self) -> str:
        """Hash the source code that the trials depend on."""
        given = self.given if isinstance(self.given, Estimator) else self.estimator
        return source_of_trials(given)

    @property
    def digest(self) -> str:
        """Identify the fitted estimator by what it depends on: its name, its options, the scan."""
        options = json.dumps(self.options, sort_keys=True, default=str)
        given = hashlib.sha256(self.given).hexdigest() if isinstance(self.given, bytes) else ""
        return f"{self.estimator} {options} {self.scan.digest} {given}"


def source_of_trials(estimator: str | Estimator) -> str:
    """Hash the source code that trials of an estimator may depend on: tactsim's, and that of the estimator's packages.

    Raises InputError if no estimator has that name.
    """
    kinds = [load(estimator)] if isinstance(estimator, str) else _kinds(estimator)
    return source_digest(*(kind.__module__ for kind in kinds))


def _kinds(estimator: Estimator) -> list[type[Estimator]]:
    """List the class of an estimator and of those that it wraps."""
    inner = [value for value in vars(estimator).values() if isinstance(value, Estimator)]
    return [type(estimator), *(kind for one in inner for kind in _kinds(one))]


def _not_portable(name: str, error: Exception) -> InputError:
    return InputError(
        f"a worker process cannot make the estimator {name} ({type(error).__name__}: {error}); "
        "define its class in a module that can be imported, or use jobs=1"
    )
