"""The sheets are measured as they are drawn: true sizes, and where they put the letter on the pad at every pose."""

import re
from dataclasses import dataclass

import numpy as np
import pytest
from command_line import refused
from matplotlib.backends.backend_agg import FigureCanvasAgg

from tactsim.bench.pad.template import PAPERS, Sheets, as_pdf, draw_sheets
from tactsim.core.pad import Pad
from tactsim.core.poses import invert, transform
from tactsim.models import letter
from tactsim.press.scan_poses import grid_poses, stage_for

POINT = 25.4 / 72  # mm
BOLD = 0.35  # mm


@dataclass
class Page:
    """What stands on a page, in mm from its lower left corner. paths: (width, points). words: (text, place)."""

    size: tuple
    paths: list
    words: list

    def lines(self, width=BOLD):
        """Straight lines of that width, as pairs of points."""
        return [points for of, points in self.paths if len(points) == 2 and abs(of - width) < 1e-3]

    def line_called(self, name):
        """The bold line that is nearest to such a text; rulers have numbers, too, but farther from their lines."""
        places = [place for text, place in self.words if text == name]
        assert places, name

        def away(line):
            length = np.linalg.norm(line[1] - line[0])
            direction = (line[1] - line[0]) / length
            normal = np.array([-direction[1], direction[0]])
            along = [(place - line[0]) @ direction / length for place in places]
            across = [abs((place - line[0]) @ normal) for place in places]
            return min(far for far, at in zip(across, along, strict=True) if -0.2 < at < 1.2)

        lines = [line for line in self.lines() if self._beside(line, places)]
        return min(lines, key=away)

    @staticmethod
    def _beside(line, places):
        """Tell whether one of the places is along the line, and not beyond its ends."""
        along = [
            (place - line[0]) @ (line[1] - line[0]) / np.sum((line[1] - line[0]) ** 2) for place in places
        ]
        return any(-0.2 < at < 1.2 for at in along)


def pages_of(figures):
    """Read lines and words where they are drawn."""
    pages = []
    for figure in figures:
        (axes,), mm = figure.axes, 25.4 / figure.dpi
        renderer = FigureCanvasAgg(figure).get_renderer()
        paths = [
            (one.get_lw() * POINT, one.get_transform().transform(one.get_xydata()) * mm) for one in axes.lines
        ]
        words = [
            (one.get_text(), one.get_window_extent(renderer).get_points().mean(axis=0) * mm)
            for one in axes.texts
        ]
        pages.append(Page(tuple(figure.get_size_inches() * 25.4), paths, words))
    return pages


def sizes_of(pdf):
    """Read how large the pages of a PDF are, mm."""
    boxes = re.findall(rb"/MediaBox \[([^\]]*)\]", pdf)
    return [tuple(float(word) * POINT for word in box.split()[2:]) for box in boxes]


LARGE = Pad(rows=10, columns=10, pitch_x=5, pitch_y=5, taxel_width=4.6, taxel_height=4.6)


@pytest.mark.parametrize("paper", PAPERS)
def test_pages_and_rulers_have_their_true_size(paper):
    figures = draw_sheets([letter("R")], Sheets(paper, Pad(), from_behind=True))
    pages = pages_of(figures)
    assert sizes_of(as_pdf(figures)) == [pytest.approx(PAPERS[paper], abs=0.01)] * 2
    for page in pages:
        assert page.size == pytest.approx(PAPERS[paper], abs=0.01)
        lengths = [np.abs(line[1] - line[0]) for line in page.lines()]
        for ruler in ((100, 0), (0, 100)):
            assert any(np.allclose(length, ruler, atol=0.005) for length in lengths)
        everything = np.vstack([points for _, points in page.paths])
        assert everything.min() > 5
        assert (everything < np.array(page.size) - 5).all()


def middle_of_rays(page):
    return np.mean([page.line_called(f"{angle}").mean(axis=0) for angle in range(0, 360, 30)], axis=0)


@pytest.mark.parametrize("pad", [Pad(), LARGE])
@pytest.mark.parametrize("behind", [True, False])
def test_the_sheets_put_the_letter_where_every_pose_of_the_scan_says(behind, pad):
    """A person lays the sheets so that the lines of x and y cross over the pad's middle, and the arrow at the angle."""
    pad_page, letter_page = pages_of(draw_sheets([letter("R")], Sheets("a4", pad, behind)))
    _, points = max(letter_page.paths, key=lambda path: len(path[1]))  # the letter's outline
    pad_middle = middle_of_rays(pad_page)
    contour = max(letter("R").contours, key=len)
    contour = np.vstack([contour, contour[:1]])
    mirror = np.array([-1.0, 1.0]) if behind else np.array([1.0, 1.0])
    for pose in grid_poses(stage_for(pad, letter("R"))):
        x, y, theta = pose
        cross = np.array(
            [letter_page.line_called(f"x {x:.4g}")[0, 0], letter_page.line_called(f"y {y:.4g}")[0, 1]]
        )
        ray = pad_page.line_called(f"{round(np.rad2deg(theta))}").mean(axis=0) - pad_middle
        ray /= np.linalg.norm(ray)
        # From behind the letter's sheet is turned until its arrow, which is up, points along the ray. From the front
        # the pad's sheet is turned until its ray points up; seen from the pad, the letter then turns likewise.
        turn = np.array([[ray[1], ray[0]], [-ray[0], ray[1]]])
        on_pad = (points - cross) @ turn.T * mirror
        assert np.allclose(on_pad, transform(invert(pose), contour), atol=0.005)


def test_what_does_not_fit_on_a_sheet_is_refused(here, tmp_path):
    (tmp_path / "big.toml").write_text(
        'name = "big"\n[codec]\nkind = "pps-csv"\ntaxels = 256\n'
        "[pad]\nrows = 16\ncolumns = 16\npitch_x = 6\npitch_y = 6\nno_seam = true\nunread_columns = 0\n"
    )
    refused(here("template", "--device", "big.toml", "--out", "t.pdf"), "the pad reaches", "has room for")
    refused(here("template", "--out", "t.png"), "FILE.pdf")
    table = (
        (tmp_path / "big.toml").read_text().replace("256", "100").replace("16", "10").replace("6\n", "5\n")
    )
    (tmp_path / "array.toml").write_text(table)
    (tmp_path / "bar.svg").write_text(
        '<svg xmlns="http://www.w3.org/2000/svg" width="30mm" height="6mm" viewBox="0 0 30 6">'
        '<rect width="30" height="6"/></svg>'
    )
    said = here(
        "template", "--device", "array.toml", "--shape", "bar.svg", "--seen", "front", "--out", "bar.pdf"
    )
    assert "2 pages in bar.pdf: the pad's sheet, then bar" in said.stdout.replace("\n", " ")
    assert not (tmp_path / "t.pdf").exists()


def test_the_command_writes_a_page_for_the_pad_and_each_letter(here, tmp_path):
    said = here("template", "--letters", "AE", "--out", "t.pdf")
    assert said.returncode == 0, said.stderr
    assert "3 pages in t.pdf" in said.stdout
    assert len(sizes_of((tmp_path / "t.pdf").read_bytes())) == 3
