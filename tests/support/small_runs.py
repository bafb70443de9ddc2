"""Small runs for the tests of the report."""

from tactsim.bench import experiment, results
from tactsim.bench.config import run_config
from tactsim.bench.runs.figures import as_bytes


def make_run_in(folder, **words):
    """Run a few trials and write their results into a new folder; gives the folder."""
    small = {"estimator": "histogram", "letters": "AEU", "trials": 4, "readings": 8}
    run = experiment.perform(run_config(**(small | words)))
    folder.mkdir(parents=True)
    results.save(run, folder)
    return folder


def draw_nothing(patch):
    """Let every picture of a run and of a report be an empty file, for tests that look at none; pages have theirs."""
    patch.setattr("tactsim.bench.runs.figures.Picture.png", lambda picture, dpi=150: b"")
    patch.setattr(
        "tactsim.bench.report.picture.as_bytes",
        lambda picture, kind, **how: as_bytes(picture, kind, **how) if "salt" in how else b"",
    )
