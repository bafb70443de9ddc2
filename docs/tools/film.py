"""Draw the looping film at the top of the README: `python docs/tools/film.py docs/pictures/recognition.gif`.

A letter is hidden, the pad touches it here and there: what the pad reads, which letter it may be, and where it is put.
"""

from __future__ import annotations

import sys
from io import BytesIO
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from PIL import Image

import tactsim
from tactsim import models
from tactsim.bench.report.recognition import Recognition, replay_all
from tactsim.bench.runs.pooled import collect
from tactsim.core import transform
from tactsim.core.poses import FloatArray

READINGS = 6
SECONDS = (1.2, 3.0)  # of a frame, and of the last
GREY, BLUE, GREEN, RED = "#c3c9d2", "#1f6fb2", "#0a7a3f", "#b3261e"
REACH = 24  # mm, from the letter's centre to the edge of the scene


def main(out: Path) -> None:
    """Recognise one letter with the default estimator and write the film."""
    run = tactsim.run(letters="AEIOU", trials=3, readings=READINGS)
    (replayed,), _ = replay_all(collect([(Path("film"), run)]), {})
    trial = replayed.recognitions[0]
    frames = [_frame(trial, replayed.scan.taxel_xy, k) for k in range(READINGS)]
    milliseconds = [int(1e3 * SECONDS[0])] * (READINGS - 1) + [int(1e3 * SECONDS[1])]
    frames[0].save(out, save_all=True, append_images=frames[1:], duration=milliseconds, loop=0, optimize=True)


def _frame(trial: Recognition, taxels: FloatArray, k: int) -> Image.Image:
    figure = Figure(figsize=(9, 3.3), layout="constrained", facecolor="white")
    scene, image, belief = figure.subplots(1, 3, width_ratios=(1.1, 0.9, 1))
    right = trial.label[k] == trial.answer
    _draw_scene(scene, trial, taxels, k, GREEN if right else RED)
    columns = len(np.unique(taxels[:, 0].round(6)))
    image.imshow(
        trial.pressures[k].reshape(-1, columns),
        origin="lower",
        cmap="Blues",
        vmin=0,
        vmax=trial.pressures.max(),
    )
    image.set(xticks=[], yticks=[])
    image.set_title("what the pad reads", fontsize=11)
    colours = [BLUE if label == trial.label[k] else GREY for label in trial.labels]
    belief.bar(trial.labels, trial.probabilities[k], color=colours)
    belief.set(ylim=(0, 1), yticks=[0, 1])
    belief.spines[["top", "right"]].set_visible(False)
    belief.set_title("which letter it may be", fontsize=11)
    said = f"{trial.label[k]}, placed {trial.error[k]:.1f} mm off" if right else f"{trial.label[k]}: wrong"
    figure.supxlabel(f"touch {k + 1} of {READINGS}: {said}", fontsize=12, color=GREEN if right else RED)
    content = BytesIO()
    figure.savefig(content, format="png", dpi=90)
    return Image.open(content).convert("P", palette=Image.Palette.ADAPTIVE, colors=64)


def _draw_scene(axes: Axes, trial: Recognition, taxels: FloatArray, k: int, colour: str) -> None:
    """Draw the hidden letter, the pad where it touched, and in dashes where the estimator puts which letter."""
    for contour in models.letter(trial.answer).contours:
        axes.fill(*np.asarray(contour).T, color=GREY, lw=0)
    low, high = taxels.min(axis=0) - 0.9, taxels.max(axis=0) + 0.9
    corners = np.array([low, [high[0], low[1]], high, [low[0], high[1]], low])
    for number in range(k + 1):
        outline = transform(trial.sensor_in_object[number], corners)
        now = number == k
        axes.plot(*outline.T, color=BLUE, lw=2.2 if now else 0.8, alpha=1 if now else 0.4)
    for contour in models.letter(trial.label[k]).contours:
        placed = transform(trial.estimate_in_object[k], np.vstack([contour, contour[:1]]))
        axes.plot(*placed.T, color=colour, lw=1.6, ls=(0, (4, 2)))
    axes.set(xlim=(-REACH, REACH), ylim=(-REACH, REACH), xticks=[], yticks=[], aspect="equal")
    axes.set_title("the hidden letter, the pad, the estimate", fontsize=11)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
