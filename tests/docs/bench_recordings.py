"""What docs/estimators.md, hardware.md and recordings.md say of pads that nobody here has seen, measured again.

    OPENBLAS_NUM_THREADS=1 python tests/docs/bench_recordings.py fitted|pads|loads [TRIALS]

fitted: `fit=auto` beside `fit=off` in six worlds. pads: `bench validate` on recordings of four pads unlike the
simulated one, with outlines that are off by 0.5 mm. loads: presses lighter than those that were trained on, by one
moment of each press and by four; the recordings are those of docs/recordings.md. TRIALS are those of each object.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import tomli_w
from manifold3d import JoinType
from pages import BLOCKS

import tactsim
from tactsim import models
from tactsim.bench.pad.validation import validate
from tactsim.core import Pad, Scan
from tactsim.press import ScanOptions, scan_letters

BENCH = Path(sys.executable).parent / "bench"
LETTERS = "AEIOU"
TOUCHES = [0, 2, 4, 9]
PAPER = 11.55  # mm, the width of the paper's pad, for which the letters are
WORLDS = {
    "default": {},
    "response 0.5": {"sensor": {"response": 0.5}},
    "response 2": {"sensor": {"response": 2.0}},
    "noise 8 kPa": {"sensor": {"noise": 8.0}},
    "unit 1000 times": {},
    "pitch 3.8 mm": {},
}
# rows, pitch (mm) and unit of a pad; what is pressed, and the truth that a fit does not know.
PADS = {
    "squares": (8, 3.8, 40.0, "AEIOU", {
        "placement_mm": 0.5, "placement_rad": 0.01, "placement_tilt": 0.002, "load_spread": 0.3,
        "press": {"force": 13.9, "stiffness": 400.0, "wrist_stiffness": 7900.0},
        "sensor": {"psf_sigma": 1.8, "gain_spread": 0.12, "response": 2.0, "response_pressure": 15, "noise": 1.0},
    }),
    "roots": (6, 3.8, 200.0, "AEOU", {
        "placement_mm": 0.4, "placement_rad": 0.01, "placement_tilt": 0.004, "load_spread": 0.29,
        "press": {"force": 8.0, "stiffness": 100.0, "wrist_stiffness": None},
        "sensor": {"psf_sigma": 2.0, "gain_spread": 0.1, "response": 0.5, "response_pressure": 1, "noise": 0.15},
    }),
    "coarse": (6, 7.0, 0.001, "AEOU", {
        "placement_mm": 1.0, "placement_rad": 0.02, "placement_tilt": 0.01, "load_spread": 0.2,
        "press": {"force": 20.0, "stiffness": 60.0, "wrist_stiffness": 20000.0},
        "sensor": {"psf_sigma": 3.0, "gain_spread": 0.15, "response": 1.4, "response_pressure": 20, "noise": 0.5},
    }),
    "fine": (6, 1.9, 10.0, "AEIOU", {
        "placement_mm": 0.3, "placement_rad": 0.02, "placement_tilt": 0.006, "load_spread": 0.25,
        "press": {"force": 3.0, "stiffness": 500.0, "wrist_stiffness": 600.0},
        "sensor": {"psf_sigma": 0.8, "gain_spread": 0.1, "response": 0.7, "response_pressure": 30, "noise": 0.5},
    }),
}  # fmt: skip
# What robot.toml of docs/recordings.md is changed to.
ROBOTS = {
    "roots, tilts by 0.004": {},
    "squares, tilts by 0.01": {
        "placement_tilt": 0.01, "sensor": {"response": 2.0, "response_pressure": 40, "noise": 1.5},
    },
}  # fmt: skip
SHAPES = [word for name in ("bracket", "cross", "tee", "wedge", "zed") for word in ("--shape", f"{name}.svg")]


def at(values):
    """Write what is right after 1, 3, 5 and 10 touches."""
    return " / ".join(f"{value:.2f}" for value in np.asarray(values)[TOUCHES])


def drawing(footprint, path):
    """Write a footprint as an SVG in mm."""
    rings = " ".join(
        "M " + " L ".join(f"{x:.4f} {-y:.4f}" for x, y in ring) + " Z" for ring in footprint.to_polygons()
    )
    path.write_text(
        '<svg xmlns="http://www.w3.org/2000/svg" width="300mm" height="300mm" viewBox="-150 -150 300 300">'
        f'<path fill-rule="evenodd" d="{rings}"/></svg>'
    )


def square_pad(rows, pitch):
    """Make a pad whose taxels are 0.2 mm apart."""
    width = pitch - 0.2
    return Pad(
        rows=rows, columns=rows, pitch_x=pitch, pitch_y=pitch, taxel_width=width, taxel_height=width, seam=0.2,
        unread_columns=0,
    )  # fmt: skip


def drawn(letters, rows, pitch, folder, rng=None):
    """Draw letters as large beside a pad as they are beside the paper's, 0.5 mm wider or narrower if `rng` is given."""
    folder.mkdir()
    times = rows * pitch / PAPER
    for letter in letters:
        footprint = models.letter(letter).footprint.scale((times, times))
        if rng is not None:
            footprint = footprint.offset(float(rng.choice([-0.5, 0.5])), JoinType.Miter)
        drawing(footprint, folder / f"{letter.lower()}.svg")
    shapes = tuple(str(folder / f"{letter.lower()}.svg") for letter in letters)
    return ScanOptions(letters=(), shapes=shapes, pad=square_pad(rows, pitch))


def fitted(trials, folder):
    """Print what `fit=auto` makes of simulated scans in six worlds."""
    print("refined, right @1 / @3 / @5 / @10; fewer right @5 with fit=auto, 95 % interval over paired trials")
    for name, world in WORLDS.items():
        options = ScanOptions(**world)
        if name.startswith("pitch"):
            large = {"force": 8.0, "wrist_stiffness": 2400.0}
            options = drawn(LETTERS, 6, 3.8, folder / "large").model_copy(
                update={"press": options.press.model_copy(update=large)}
            )
        scan, _ = scan_letters(options)
        if name.startswith("unit"):
            scan = replace(scan, readings=1000 * scan.readings)
        off, auto = (
            tactsim.run(scan=scan, set={"fit": fit}, letters=None, trials=trials, readings=10)
            for fit in ("off", "auto")
        )
        lost = off.trials.right[:, 4].astype(float) - auto.trials.right[:, 4]
        error = 1.96 * lost.std() / np.sqrt(len(lost))
        print(
            f"| {name} | {at(off.accuracy)} | {at(auto.accuracy)} | {lost.mean():+.3f} ± {error:.3f} |",
            flush=True,
        )


def pads(trials, folder):
    """Print what `bench validate` finds in recordings of unlike pads, and what the fitted world trains."""
    rng = np.random.default_rng(1)
    for name, (rows, pitch, unit, letters, truth) in PADS.items():
        simulated, _ = scan_letters(drawn(letters, rows, pitch, folder / f"{name} as drawn"))
        real = drawn(letters, rows, pitch, folder / f"{name} as made", rng)
        stated = real.model_dump(mode="json", exclude={"press", "sensor"})
        read, _ = scan_letters(ScanOptions.model_validate({**stated, **truth, "seed": 101}))
        recorded = Scan(
            read.readings * unit, read.poses, read.labels, read.split, read.taxel_xy,
            {"source": "recorded", "unit": "count"},
        )  # fmt: skip
        begin = time.process_time()
        result = validate(
            simulated, recorded, estimators=("refined",), trials=trials, progress=lambda *_: None
        )
        seconds, fit = time.process_time() - begin, result.fit
        found = [
            f"{label} {value:.3g} ({low:.3g} to {high:.3g}; {true:g})"
            for label, value, (low, high), true in (
                ("response", fit.response, fit.response_range, truth["sensor"]["response"]),
                ("spread", fit.psf_sigma, fit.psf_sigma_range, truth["sensor"]["psf_sigma"]),
                ("placed", fit.placement_mm, fit.placement_mm_range, truth["placement_mm"]),
                ("loads", fit.load_spread, fit.load_spread_range, truth["load_spread"]),
            )
        ]
        print(f"{name}, {seconds:.0f} s of processor time, found (95 %; truth): {', '.join(found)}")
        for side, figures in result.recognition["refined"].items():
            print(f"| {name} | {side} | {at(figures['accuracy'])} | {figures['touches_to_95']} |", flush=True)


def loads(trials, folder):
    """Print how well lighter presses are recognised, trained on one moment of each press and on four."""
    os.chdir(folder)
    for block in BLOCKS:
        if block.page == "docs/recordings.md" and block.file:
            Path(block.file).write_text(block.text)
        elif block.page == "docs/recordings.md" and block.language == "python":
            page = {}
            exec(compile(block.text, block.page, "exec"), page)
    robot = tomllib.loads(Path("robot.toml").read_text())
    for seed, split in ((1, "train"), (2, "test")):
        page["plan"](f"{split}.csv", presses=10, reach=8, seed=seed)
        lines = Path(f"{split}.csv").read_text().splitlines()
        of = [line.replace(",train,", f",{split},").replace(",test,", f",{split},") for line in lines[1:]]
        Path(f"{split}.csv").write_text("\n".join([lines[0], *of]))
    print("refined, right @1 / @3 / @5 / @10; 90 % regions hold the truth @10; refused @10 with unknown=0.2")
    for name, changes in ROBOTS.items():
        world = {**robot, **changes, "load_spread": 0.0}
        world["sensor"] = {**robot["sensor"], **changes.get("sensor", {})}
        Path("world.toml").write_text(tomli_w.dumps(world))
        record("train", robot["press"]["force"], "one.npz")
        replay("several.npz", "--moments", "auto")
        for share in (0.9, 0.75, 0.5):
            record("test", share * robot["press"]["force"], "test.npz")
            for train in ("one", "several"):
                words = {"scan": "test.npz", "train_scan": f"{train}.npz", "letters": None, "trials": trials}
                run = tactsim.run(**words, readings=10, set={"unknown": 0.2} if share == 0.9 else {})
                refused = f"{run.refused_known[9]:.3f}" if share == 0.9 else ""
                held = f"{run.coverage_90[9]:.2f}"
                print(
                    f"| {name} | {share:.0%} | {train} | {at(run.accuracy)} | {held} | {refused} |",
                    flush=True,
                )


def record(plan, force, out):
    """Let the robot press a plan with a force, and make a scan of the recording."""
    for path in ("robot.tactrec", "marks.csv"):
        Path(path).unlink(missing_ok=True)
    bench(
        "emulate", "--device", "array.toml", "--plan", f"{plan}.csv", "--out", "robot.tactrec", "--marks", "marks.csv",
        "--world", "world.toml", "--scan-set", f"press.force={force}", "--rate", "100", "--hold", "0.3", "--lift",
        "0.2", "--jitter", "0.5", *SHAPES,
    )  # fmt: skip
    replay(out)


def replay(out, *words):
    """Make a scan of windows of 6x6 taxels of the last recording."""
    Path(out).unlink(missing_ok=True)
    bench(
        "replay", "robot.tactrec", "--device", "array.toml", "--marks", "marks.csv", "--cut", "6x6", "--stride", "3",
        "--scan", out, *SHAPES, *words,
    )  # fmt: skip


def bench(*words):
    """Call the command line."""
    subprocess.run([BENCH, *words], check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


if __name__ == "__main__":
    tables = {"fitted": fitted, "pads": pads, "loads": loads}
    options = argparse.ArgumentParser()
    options.add_argument("table", choices=tables)
    options.add_argument("trials", metavar="TRIALS", type=int, nargs="?", default=20, help="a whole number")
    asked = options.parse_args()
    begin = time.process_time()
    with tempfile.TemporaryDirectory() as place:
        tables[asked.table](asked.trials, Path(place))
    print(f"{time.process_time() - begin:.0f} s of processor time, without that of recording")
