import pickle
from hashlib import sha256

import pytest
from synthetic import make_scan

from tactsim.core import Scan
from tactsim.estimators.filters import refined
from tactsim.estimators.options import LikelihoodOptions
from tactsim.press import ScanOptions, scan_letters


@pytest.fixture(scope="session", autouse=True)
def weights_are_learned_once():
    """Learn how much a sequence counts once from equal models and readings, by fewer moves: it takes most of a fit.

    It follows from them alone, however a filter is made besides. test_trust.py asks for it anew each time,
    and by all moves.
    """
    learn, known = refined.learn_trust, {}

    def learn_once(likelihood, scan):
        learned = {name: value for name, value in vars(likelihood).items() if name != "options"}
        options = likelihood.options.model_dump(include=set(LikelihoodOptions.model_fields))
        key = sha256(pickle.dumps((type(likelihood), learned, options, scan.digest))).digest()
        if key not in known:
            with pytest.MonkeyPatch.context() as fewer:
                fewer.setattr(likelihood, "moves", likelihood.moves // 4)
                known[key] = learn(likelihood, scan)
        return known[key]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(refined, "learn_trust", learn_once)
        yield


@pytest.fixture(scope="session")
def scan() -> Scan:
    """Four shapes at the paper's 192 poses, on a pad of 6 x 6 taxels; no physics."""
    return make_scan()


@pytest.fixture(scope="session")
def vowels(shared_cache) -> Scan:
    """The paper's experiment: five letters, test readings at the training poses."""
    return scan_letters(ScanOptions(test_poses="same"))[0]
