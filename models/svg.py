"""Read the filled outlines of an SVG drawing, in mm, as they are seen."""

from __future__ import annotations

import math
import re
import warnings
from collections.abc import Iterator
from io import BytesIO
from typing import TYPE_CHECKING, Any
from xml.etree.ElementTree import Element, ParseError

import numpy as np

from tactsim.core.errors import InputError
from tactsim.core.poses import FloatArray

if TYPE_CHECKING:
    from manifold3d import CrossSection

FLATTENING = 0.01  # mm: no chord of a curve is further from it
MOST_CHORDS = 5_000
LARGEST_FILE = 2 << 20  # bytes
LARGEST = 1e4  # mm

_SVG = "{http://www.w3.org/2000/svg}"
_UNITS = {"": 25.4 / 96, "px": 25.4 / 96, "mm": 1.0, "cm": 10.0, "in": 25.4, "pt": 25.4 / 72, "pc": 25.4 / 6}
_DRAWN = {"path", "rect", "circle", "ellipse", "polygon", "polyline"}
_HARMLESS = {"svg", "g", "title", "desc", "metadata", "defs", "style"}
_BAD_STYLE = re.compile(rb"\b(display|visibility|fill-rule|transform|clip-path|mask)\b|fill\s*:\s*none")


def filled_region(content: bytes) -> CrossSection:
    """Unite the filled outlines of a drawing into one region, mm, y upwards.

    Lengths follow the SVG standard: `width` and `height` with their units size the `viewBox`, and a plain
    number is a pixel of 1/96 inch. Transforms, groups and fill rules count. Curves become chords within
    FLATTENING. Raises InputError if the content is not SVG, or draws text or clones, or has no filled outline.
    """
    from manifold3d import CrossSection, FillRule, OpType

    if len(content) > LARGEST_FILE:
        raise InputError(f"the drawing has {len(content):,} bytes; the most is {LARGEST_FILE:,}")
    regions, chords = [], 0
    for contours, even_odd in _outlines(content):
        chords += sum(map(len, contours))
        if chords > MOST_CHORDS:
            raise InputError(f"the drawing has more than {MOST_CHORDS:,} chords; simplify its paths")
        regions.append(CrossSection(contours, FillRule.EvenOdd if even_odd else FillRule.NonZero))
    if not regions:
        raise InputError(
            "there is no filled outline in the drawing; strokes do not count: convert them to paths"
        )
    return CrossSection.batch_boolean(regions, OpType.Add)


def _outlines(content: bytes) -> Iterator[tuple[list[FloatArray], bool]]:
    """Give each filled element's closed chords, (k, 2) mm each, and whether its fill rule is even-odd."""
    try:
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            yield from _flattened(content)
    except InputError:
        raise
    except ParseError as error:
        raise InputError(f"not an SVG drawing: {error}") from error
    except Exception as error:
        # A parser may raise anything on untrusted bytes; to the user every exception means the same.
        raise InputError(
            "not a drawing that can be read: an outline, a length (a plain number) or a transform in it is cut off "
            "or wrong; save it again as plain SVG"
        ) from error


def _flattened(content: bytes) -> Iterator[tuple[list[FloatArray], bool]]:
    from svgpathtools import Document

    if b"<!ENTITY" in content:
        raise InputError("it defines XML entities; save it as plain SVG")
    document = Document(BytesIO(content), strict_transform_parsing=True)
    if document.root.tag != f"{_SVG}svg":
        raise InputError(f'its root is <{document.root.tag}>, not <svg xmlns="{_SVG[1:-1]}">')
    scale = _scale(document.root)
    looks = _looks(document.root)
    for path in document.paths(path_filter=lambda element: element.tag.removeprefix(_SVG) in _DRAWN):
        look = looks[path.element]
        hidden = look.get("display") == "none" or look.get("visibility", "visible") != "visible"
        if hidden or look.get("fill") == "none":
            continue
        contours = [_chords(part, scale) for part in path.continuous_subpaths() if len(part)]
        yield [contour for contour in contours if len(contour) > 2], look.get("fill-rule") == "evenodd"


def _chords(segments: Any, scale: float) -> FloatArray:
    """Flatten a run of lines, Bezier curves and arcs into corners (k, 2) mm, y upwards."""
    found: list[complex] = []
    for segment in segments:
        count = _chord_count(segment, scale)
        if len(found) + count > MOST_CHORDS:
            raise InputError(f"the drawing has more than {MOST_CHORDS:,} chords; simplify its paths")
        found += [complex(segment.point(k / count)) for k in range(count)]
    found.append(complex(segments[-1].end))  # an open outline is filled as if it were closed
    corners = np.array(found) * scale
    if not np.isfinite(corners).all() or np.abs(corners).max(initial=0) > LARGEST:
        raise InputError(f"a corner lies more than {LARGEST:g} mm from the drawing's origin")
    return np.stack([corners.real, -corners.imag], axis=1)


def _chord_count(segment: Any, scale: float) -> int:
    """Count the chords that keep a segment within FLATTENING: a chord is off by its length^2 curvature / 8."""
    from svgpathtools import Arc, Line

    if isinstance(segment, Line):
        return 1
    if isinstance(segment, Arc):
        radius = max(segment.radius.real, segment.radius.imag) * scale
        bend = math.radians(abs(segment.delta)) ** 2 * radius
    else:
        p = np.array(segment.bpoints()) * scale
        degree = len(p) - 1
        bend = degree * (degree - 1) * float(np.abs(p[:-2] - 2 * p[1:-1] + p[2:]).max())
    return math.ceil(min(max(math.sqrt(bend / (8 * FLATTENING)), 1), MOST_CHORDS + 1))


def _scale(root: Element) -> float:
    """Give the mm of one user unit: the drawing's width over that of its viewBox (SVG 2, section 8)."""
    box = [float(number) for number in re.split(r"[\s,]+", root.get("viewBox", "").strip()) if number]
    if box and (len(box) != 4 or min(box[2:]) <= 0):
        raise InputError(
            f"its viewBox is {root.get('viewBox')!r}; it needs four numbers, the last two positive"
        )
    ratios = []
    for key, extent in zip(("width", "height"), box[2:4] or (0.0, 0.0), strict=True):
        size = re.fullmatch(r"\s*([0-9.eE+-]+)\s*([a-z]*)\s*", root.get(key, ""))
        if size is None:
            continue  # absent or a share of the window: it says nothing about mm
        if size[2] not in _UNITS:
            raise InputError(
                f"its {key} is {root.get(key)!r}; the units are {', '.join(filter(None, _UNITS))}"
            )
        if box:
            ratios.append(float(size[1]) * _UNITS[size[2]] / extent)
    scale = min(ratios, default=_UNITS["px"])
    if not (math.isfinite(scale) and scale > 0):
        raise InputError("its width, height and viewBox give no scale; give them as positive numbers")
    return scale


def _looks(root: Element) -> dict[Element, dict[str, str]]:
    """Find each element's fill, fill-rule, display and visibility; refuse elements that cannot be read."""
    looks = {}
    stack: list[tuple[Element, dict[str, str]]] = [(root, {})]
    while stack:
        element, inherited = stack.pop()
        tag = element.tag.removeprefix(_SVG) if isinstance(element.tag, str) else "style"
        if tag.startswith("{"):
            continue  # an editor's own notes
        if tag not in _DRAWN | _HARMLESS or (tag == "svg" and element is not root):
            raise InputError(f"it draws a <{tag}>; only filled outlines are read: convert it to a path")
        if tag == "style" and _BAD_STYLE.search((element.text or "").encode()):
            raise InputError("its style sheet hides or clips; give each element its own style (plain SVG)")
        style = (part.split(":", 1) for part in element.get("style", "").split(";") if ":" in part)
        own = {**element.attrib, **{key.strip(): value.strip() for key, value in style}}
        if own.get("clip-path", "none") != "none" or own.get("mask", "none") != "none":
            raise InputError("it clips or masks an outline; apply the clip and save again")
        keys = ("fill", "fill-rule", "display", "visibility")
        look = {**inherited, **{key: own[key] for key in keys if key in own}}
        if inherited.get("display") == "none":
            look["display"] = "none"
        looks[element] = look
        if tag in ("svg", "g"):
            stack += [(child, look) for child in element]
    return looks
