"""Read the filled outlines of an SVG drawing, in mm, as a renderer shows them.

Paths are read by svg.path, style sheets by tinycss2 and cssselect2, and manifold3d joins the regions. No library does
all of it: of 66 drawings with a known area in tests/models/test_drawings.py, svgelements 1.9.6 gets 27 wrong (clip
paths, inner pages, opacity of groups, `!important`, selectors of more than one element, even-odd rules from a sheet)
and picosvg 0.23 gets 47 wrong (style sheets, lengths with units, percentages); Python's bindings of resvg render, and
do not give its outlines.
"""

from __future__ import annotations

import gzip
import math
import re
import zlib
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from importlib.util import find_spec, module_from_spec
from io import BytesIO
from itertools import groupby, pairwise
from typing import Any, NamedTuple
from urllib.parse import unquote
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np
import tinycss2
from manifold3d import CrossSection, FillRule, OpType
from svg.path import Linear, Move

from tactsim.core.errors import InputError, short
from tactsim.core.poses import FloatArray
from tactsim.models.css import ELSEWHERE, SVG, Paint, Rgb, Style, color, computed, declarations, share, url_in

FLATTENING = 5e-5  # share of the page's longer side: no chord of a curve is further from it
LARGEST_FLATTENING = 0.002  # mm
MOST_CHORDS = 50_000  # uniting them takes seconds
MOST_IN_OUTLINE = 20_000  # chords of an outline, of which each may cross each
MOST_ELEMENTS = 100_000  # clones counted each time
LARGEST_FILE = 2 << 20  # bytes
LARGEST = 1e4  # mm
WHOLE_PAGE = 1e-3  # share of the page that a fill may leave free and still be the page itself
_POINTS = re.compile(r"[-+.,\deE\s]*")
_SAMPLES = 32  # steps along a curve by which its bend is measured
WHITE = 250  # least red, green and blue of white: CorelDRAW's is #fefefe
FAINT = 0.01  # opacity of what can hardly be seen
OPAQUE = 0.99  # a white fill hides what lies below it from this opacity on
PIXEL = 25.4 / 96  # mm

_HREFS = ("href", "{http://www.w3.org/1999/xlink}href")
_MARKED = {"path", "line", "polyline", "polygon"}
_SHAPES = {*_MARKED, "rect", "circle", "ellipse"}
_GRADIENTS = (f"{SVG}linearGradient", f"{SVG}radialGradient")
_UNITS = {
    "": 1.0, "px": 1.0, "mm": 96 / 25.4, "cm": 960 / 25.4, "q": 24 / 25.4, "in": 96.0, "pt": 4 / 3, "pc": 16.0,
}  # fmt: skip
_ANGLES = {"": 1.0, "deg": 1.0, "grad": 0.9, "rad": 180 / math.pi, "turn": 360.0}
_MOVING = {f"{SVG}{tag}" for tag in ("set", "animate", "animateMotion", "animateTransform")}
_TEXT = ("text", "tspan", "textPath", "a")
_FOREIGN = dict.fromkeys((*_TEXT, "flowRoot"), "text") | {
    "image": "a picture",
    "foreignObject": "foreign content",
}
_DRAWN = {f"{SVG}{tag}" for tag in (*_SHAPES, *_FOREIGN, "g", "switch", "svg", "use")}
_HIDDEN = ("hidden", "collapse")
# What svg.path, tinycss2 and the arithmetic raise on outlines, styles and lengths that are cut off or wrong.
_DAMAGED = (ArithmeticError, AssertionError, AttributeError, LookupError, RuntimeError, TypeError, ValueError)
# A radius has no sign (SVG 2, section 9.5.1). The parser is a copy: others in this process keep theirs as it is.
_spec = find_spec("svg.path.parser")
_parser: Any = module_from_spec(_spec)  # type: ignore[arg-type]
_spec.loader.exec_module(_parser)  # type: ignore[union-attr]
_parser.FIELD_POPPERS["u"] = lambda text: abs(_parser.pop_number(text))


class Drawing(NamedTuple):
    """What of a drawing is seen: its region, mm, y upwards, and lines that say what was left out."""

    region: CrossSection
    remarks: list[str]


class _Fill(NamedTuple):
    """What a shape fills, which may be nothing, whether it has a stroke, and the groups of `_Context` around it."""

    region: CrossSection
    paint: Paint
    stroked: bool
    groups: tuple[int, ...]


@dataclass(frozen=True)
class _Context:
    """What holds for an element from those around it.

    matrix: (2, 3), from user units to mm, y upwards. view: width and height of the viewport, user units; None if
    unknown. clip: what of it is seen. alpha: the opacity of the groups around it. hazard: what in them may change the
    outline and is not understood. blends: whether they mix with what lies below. groups: those that what lies below
    shines through, by number. clones: the elements that are being cloned. size: the width and height that a clone of a
    page gets.
    """

    style: Style
    matrix: FloatArray
    view: tuple[float, float] | None
    clip: CrossSection | None = None
    alpha: float = 1.0
    hazard: str = ""
    blends: bool = False
    groups: tuple[int, ...] = ()
    clones: tuple[Element, ...] = ()
    size: Style = field(default_factory=dict)

    def within(self, region: CrossSection) -> _Context:
        """Add what no more than `region` of is seen."""
        return replace(self, clip=region if self.clip is None else region ^ self.clip)


def filled_region(content: bytes) -> Drawing:
    """Unite what a drawing fills into one region, mm, y upwards.

    Lengths follow the SVG standard: `width` and `height` with their units size the `viewBox`, and a plain number is a
    pixel of 1/96 inch. Styles, transforms, clones, clip paths and masks of black and white count; what lies outside the
    page does not. A fill of the whole page with others on it is the page. White on another fill is a hole. Curves
    become chords within FLATTENING of the page, LARGEST_FLATTENING at most.

    Raises InputError if the content is not SVG, fills nothing that is seen, or holds what changes the outline and is
    not read: text, pictures, other masks, filters, patterns, markers.
    """
    try:
        if content.startswith(b"\x1f\x8b"):  # .svgz
            content = gzip.GzipFile(fileobj=BytesIO(content)).read(LARGEST_FILE + 1)
        if len(content) > LARGEST_FILE:
            raise InputError(f"the drawing has more than {LARGEST_FILE:,} bytes: simplify it")
        root = ElementTree.fromstring(content)
    except (EOFError, OSError, zlib.error, ElementTree.ParseError, LookupError, ValueError) as error:
        raise InputError(f"not an SVG drawing: {error}") from error
    if root.tag != f"{SVG}svg":
        raise InputError(f'its root is <{short(root.tag)}>, not <svg xmlns="{SVG[1:-1]}">')
    if re.search(rb"<\?xml-stylesheet\s", re.sub(rb"<!--.*?-->|<svg.*", b"", content, flags=re.DOTALL)):
        raise InputError(f"{ELSEWHERE}, <?xml-stylesheet>: put that into a <style>")
    try:
        with np.errstate(all="ignore"):
            return _Reader(root).read()
    except InputError:
        raise
    except _DAMAGED as error:
        raise InputError(
            "not a drawing that can be read: an outline, a length or a transform in it is cut off or wrong; save it "
            "again as plain SVG"
        ) from error


class _Reader:
    def __init__(self, root: Element) -> None:
        self.root = root
        self.declared = declarations(root)
        self.named = {
            element.attrib["id"]: element for element in reversed([*root.iter()]) if "id" in element.attrib
        }
        self.parents = {child: parent for parent in root.iter() for child in parent}
        self.chords = self.elements = 0

    def read(self) -> Drawing:
        matrix, view, size = _page(self.declared[self.root])
        page = None
        self.flattening = LARGEST_FLATTENING
        if size is not None:
            self.flattening = min(FLATTENING * max(size), LARGEST_FLATTENING)
            page = CrossSection.square(size).mirror((0, 1))
        drawn = list(self._walk([(self.root, _Context({}, matrix, view))], self._fill))
        if moves := sorted(_MOVING & {element.tag for element in self.root.iter()}):
            raise InputError(f"it changes while it is shown (<{moves[0].removeprefix(SVG)}>): take that out")
        strokes = sum(part.stroked for part in drawn)
        fills = [part for part in drawn if not part.region.is_empty()]
        pages, remarks = 0, []
        if fills and page is not None:
            area = _united(fills).area()
            fills = [fill._replace(region=fill.region ^ page) for fill in fills]
            inside = _united(fills).area()
            if inside == 0:
                raise InputError("all that it fills lies outside the page: fit the page to the drawing")
            if inside < area * (1 - WHOLE_PAGE):
                remarks.append(f"{area - inside:.4g} mm^2 that lie outside the page are left out")
            whole = [fill.region.area() > (1 - WHOLE_PAGE) * page.area() for fill in fills]
            pages = [*whole[:-1], False].index(False)
            if all(whole) and strokes > sum(fill.stroked for fill in fills):
                fills = []  # a page with strokes on it
        if not fills:
            why = f", only strokes ({strokes:,}): convert them to paths" if strokes else " that is seen"
            raise InputError(f"there is no filled outline in the drawing{why}")
        if strokes:
            remarks.insert(0, f"{strokes:,} strokes are left out: only what is filled counts")
        if self.root.find(f".//{SVG}script") is not None:
            remarks.append("a script in it is not run")
        if pages:
            remarks.append("a fill of the whole page is left out: it is the page and not the shape")
        if faint := sum(fill.paint.alpha < FAINT for fill in fills[pages:]):
            remarks.append(f"{faint:,} fills that fade out or can hardly be seen count as filled")
        region = _seen(fills[pages:], fills[pages - 1].paint.rgb if pages else None, remarks)
        style = computed({"transform-origin": "50% 50%"} | self.declared[self.root], {})
        if style["transform"] != "none":  # of the page as a whole, in pixels about its middle
            turn = _transform(style, None if size is None else tuple(size / PIXEL))
            region = region.transform(np.diag([1.0, -1.0]) @ turn @ np.diag([1.0, -1.0, PIXEL]))
        return Drawing(region, remarks)

    def _walk(
        self, elements: list[tuple[Element, _Context]], leaf: Callable[[Element, _Context], Any]
    ) -> Iterator[Any]:
        """Give what `leaf` makes of each outline that is shown, in the order in which they are painted."""
        stack = elements[::-1]
        while stack:
            element, around = stack.pop()
            self.elements += 1
            if self.elements > MOST_ELEMENTS:
                raise InputError(f"it draws more than {MOST_ELEMENTS:,} elements: simplify it")
            tag = element.tag.removeprefix(SVG)
            symbol = tag == "symbol" and element in around.clones
            if not (symbol or _is_shown(element)):
                continue
            declared = self.declared[element]
            style = computed(declared, around.style)
            if style["display"] == "none":
                continue
            opacity, blends = share(style["opacity"]), style["mix-blend-mode"] != "normal"
            here = replace(around, style=style, alpha=around.alpha * opacity, blends=around.blends or blends)
            if opacity < OPAQUE:
                here = replace(here, groups=(*here.groups, self.elements))
            if style["transform"] != "none" and element is not self.root:
                if style["transform-box"] != "view-box":
                    here = replace(here, hazard="a transform about the box of an element")
                here = replace(here, matrix=_joined(here.matrix, _transform(style, here.view)))
            if tag == "use":
                x, y = (_length(declared, key, here.view, index) for index, key in enumerate(("x", "y")))
                here = replace(here, matrix=_joined(here.matrix, np.array([[1.0, 0, x], [0, 1.0, y]])))
            elif tag in ("svg", "symbol") and element is not self.root:
                here = self._viewport(declared, here)  # in whose frame its clip path and mask are
            for key in ("filter", "translate", "rotate", "scale"):
                if style[key] != "none" and url_in(style[key])[0] in {None, *self.named}:
                    here = replace(here, hazard=f"a {key}")
            for key in ("mask", "clip-path"):
                if style[key] != "none":
                    here = self._cut(here, key)
                    if element is self.root:  # where a unit is a pixel
                        here = replace(here, hazard=f"a {key} of the whole page")
            if tag in _SHAPES:
                yield from leaf(element, here)
            elif tag == "use":
                stack += self._cloned(element, here)
            elif tag == "switch":
                stack += [(child, here) for child in element if _is_shown(child)][:1]
            else:
                if tag in _FOREIGN:
                    self._refuse_foreign(element, tag, here)
                stack += [(child, here) for child in reversed(element)]

    def _fill(self, element: Element, here: _Context) -> Iterator[_Fill]:
        """Give the region of a shape that is filled, and whether it has a stroke."""
        style = here.style
        if style["visibility"] in _HIDDEN:
            return
        wide = not re.fullmatch(r"0*\.?0*(px)?", style["stroke-width"])
        stroked = wide and self._paint("stroke", here) is not None
        fill = self._paint("fill", here)
        markers = {url_in(style[key])[0] for key in ("marker", "marker-start", "marker-mid", "marker-end")}
        if markers & self.named.keys() and element.tag.removeprefix(SVG) in _MARKED:
            raise InputError("it draws markers (arrow heads) at ends of an outline: convert them to paths")
        region = CrossSection()
        if fill is not None and element.tag != f"{SVG}line":
            if here.blends and min(fill.rgb or (0,)) >= WHITE:
                here = replace(here, hazard="white that is mixed with what lies below it (mix-blend-mode)")
            region = self._region(element, here, style["fill-rule"])
        if stroked or not region.is_empty():
            yield _Fill(region, fill or Paint(None, 0.0), stroked, here.groups)

    def _region(self, element: Element, here: _Context, rule: str) -> CrossSection:
        """Flatten a shape's outlines, each of which is closed, and give the region within, clipped, mm."""
        contours, before = [], self.chords
        declared = self.declared[element] | {"d": here.style["d"]}
        for part in _subpaths(_path_data(element.tag.removeprefix(SVG), declared, here.view)):
            contours.append(_chords(part, here.matrix, self.flattening))
            self.chords += len(contours[-1])
            if self.chords > min(MOST_CHORDS, before + MOST_IN_OUTLINE):
                raise InputError(
                    f"it has more than {MOST_CHORDS:,} chords, or {MOST_IN_OUTLINE:,} in an outline: simplify it"
                )
        region = CrossSection(contours, FillRule.EvenOdd if rule == "evenodd" else FillRule.NonZero)
        if region.num_vert() > MOST_IN_OUTLINE:
            raise InputError(
                f"an outline crosses itself in {region.num_vert():,} corners; the most is {MOST_IN_OUTLINE:,}"
            )
        region = region if here.clip is None else region ^ here.clip
        if here.hazard and not region.is_empty():
            raise InputError(
                f"it has {here.hazard}, which can change the outline: apply it and save again as plain SVG"
            )
        return region

    def _paint(self, key: str, here: _Context) -> Paint | None:
        """Tell what fills or strokes a shape; None if it cannot be seen."""
        style = here.style
        link, text = url_in(style[key])
        paint = color(text, style)
        if link in self.named:
            server = self.named[link]
            if server.tag == f"{SVG}pattern" and key == "fill":
                raise InputError("it fills an outline with a pattern: give it one colour")
            if server.tag in _GRADIENTS:
                if self._style(server)["display"] == "none":
                    raise InputError("a gradient in it is not displayed, which renderers read differently")
                paint = self._gradient(server)
        alpha = share(style[f"{key}-opacity"])
        if paint is None or paint.alpha * alpha * here.alpha == 0:
            return None
        return Paint(paint.rgb, paint.alpha * alpha)

    def _gradient(self, server: Element | None) -> Paint | None:
        """Take a gradient for its colour if it has one only; None if all of it is transparent."""
        seen: list[Element] = []
        stops: list[Paint] = []
        edges: list[tuple[float, bool]] = []  # where a stop lies, and whether it shows nothing
        while server is not None and server.tag in _GRADIENTS and server not in seen and not stops:
            seen.append(server)
            for stop in server.iter(f"{SVG}stop"):
                style = self._style(stop)
                paint = color(style["stop-color"], style) or Paint(None, 0.0)
                stops.append(Paint(paint.rgb, paint.alpha * share(style["stop-opacity"])))
                blank = stops[-1].alpha == 0 or min(paint.rgb or (0,)) >= WHITE
                edges.append((share(stop.get("offset", "0").strip() or "0"), blank))
            server = self.named.get(_link(server.attrib))
        if any(a[0] == b[0] and a[1] != b[1] for a, b in pairwise(edges)):
            raise InputError("a gradient in it ends sharply in white or in nothing: cut the outline there")
        colours = {stop.rgb for stop in stops if stop.alpha > 0}
        if not colours:
            return None
        least = min(stop.alpha for stop in stops)
        return Paint(colours.pop() if len(colours) == 1 else None, max(least, 1 / 255))

    def _style(self, element: Element) -> Style:
        """Compute the properties of an element that is referred to, from where it stands."""
        parent = self.parents.get(element)
        around = {} if parent is None else self._style(parent)
        hidden = {"display": "none"} if around.get("display") == "none" else {}
        return computed(self.declared[element] | hidden, around)

    def _cut(self, here: _Context, key: str) -> _Context:
        """Add an element's clip path, or a mask that shows or hides, to what holds for it."""
        name, tag = {"clip-path": ("clip path", f"{SVG}clipPath"), "mask": ("mask", f"{SVG}mask")}[key]
        link, rest = url_in(here.style[key])
        if link is None or rest:
            return replace(here, hazard=f"a {name} of its style ({here.style[key][:40]})")
        part = self.named.get(link)
        if part is None or part.tag != tag:
            return here
        if part in here.clones:
            raise InputError(f"a {name} in it refers to itself")
        declared, style = self.declared[part], self._style(part)
        if style["display"] == "none":
            return replace(here, hazard=f"a {name} that is not displayed, which renderers read differently")
        if "objectBoundingBox" in (declared.get("clipPathUnits"), declared.get("maskContentUnits")):
            return replace(here, hazard=f"a {name} in units of a box")
        inner = replace(
            here, style=style, clip=None, alpha=1.0, hazard="", groups=(), clones=(*here.clones, part)
        )
        if style[key] != "none":
            inner = self._cut(inner, key)  # which a clip path's own transform does not move
        if key == "mask":
            region = self._mask_region(part, inner)
        else:
            if style["transform"] != "none":
                inner = replace(inner, matrix=_joined(inner.matrix, _transform(style, inner.view)))
            parts = [(child, inner) for child in part if self._may_clip(child)]
            regions = list(self._walk(parts, self._clip_part))
            region = CrossSection.batch_boolean(regions, OpType.Add) if regions else CrossSection()
        if region is None:
            return replace(here, hazard="a mask that does more than show or hide")
        return replace(here.within(region), hazard=here.hazard or inner.hazard)

    def _mask_region(self, mask: Element, inner: _Context) -> CrossSection | None:
        """Give what a mask shows: where it is white, or filled if its alpha counts; None if it shows a part only."""
        region = CrossSection()
        for fill in self._walk([(child, inner) for child in mask], self._fill):
            shows = inner.style["mask-type"] == "alpha" or min(fill.paint.rgb or (0,)) >= WHITE
            whole = fill.paint.alpha >= OPAQUE and not (fill.stroked or fill.groups)
            if not (whole and (shows or max(fill.paint.rgb or (255,)) <= 255 - WHITE)):
                return None
            region = region + fill.region if shows else region - fill.region
        declared = {"x": "-10%", "y": "-10%", "width": "120%", "height": "120%"} | self.declared[mask]
        if declared.get("maskUnits") == "userSpaceOnUse":
            x, y, width, height = _rectangle(declared, inner.view)
            region ^= CrossSection.square((width, height)).translate((x, y)).transform(inner.matrix)
        else:
            x, y, width, height = _rectangle(declared, (1.0, 1.0))
            if max(x, y) > 0 or min(x + width, y + height) < 1:
                return None
        return region

    def _may_clip(self, child: Element) -> bool:
        """Tell whether a child of a clip path is a shape, a text or a clone of one: others do not count."""
        drawn = self.named.get(_link(child.attrib)) if child.tag == f"{SVG}use" else child
        return drawn is not None and drawn.tag in {f"{SVG}text", *(f"{SVG}{tag}" for tag in _SHAPES)}

    def _clip_part(self, element: Element, here: _Context) -> Iterator[CrossSection]:
        if here.style["visibility"] not in _HIDDEN:
            yield self._region(element, here, here.style["clip-rule"])

    def _viewport(self, declared: Style, here: _Context) -> _Context:
        """Enter an inner <svg> or a cloned <symbol>."""
        sized = {"width": "100%", "height": "100%"} | declared | here.size
        x, y, width, height = _rectangle(sized, here.view)
        box = _view_box(declared)
        fit = _fit(box, width, height, declared.get("preserveAspectRatio", "")) if box else np.eye(2, 3)
        if here.style["overflow"] in ("hidden", "scroll", "clip"):
            frame = CrossSection.square((width, height)).translate((x, y))
            here = here.within(frame.transform(here.matrix))
        matrix = _joined(here.matrix, _joined(np.array([[1.0, 0, x], [0, 1.0, y]]), fit))
        view = (box[2], box[3]) if box else (width, height)
        return replace(here, matrix=matrix, view=view, size={})

    def _cloned(self, use: Element, here: _Context) -> list[tuple[Element, _Context]]:
        """List what a <use> shows, in its own frame."""
        declared = self.declared[use]
        link = _link(declared)
        if "#" in link:
            raise InputError(f"it shows a part of another file, {short(link)}: put that into the drawing")
        element = self.named.get(link)
        if element is None or element in here.clones or use in element.iter():
            return []
        size: Style = {}
        if element.tag in (f"{SVG}symbol", f"{SVG}svg"):
            size = {key: declared[key] for key in ("width", "height") if key in declared}
        return [(element, replace(here, clones=(*here.clones, element), size=size))]

    def _refuse_foreign(self, element: Element, tag: str, here: _Context) -> None:
        """Refuse text or a picture that is seen."""
        own = [element.text or "", *(child.tail or "" for child in element)]
        text = "".join(element.itertext() if tag == "flowRoot" else own).strip()
        content = {"image": _link(element.attrib), "foreignObject": len(element)}.get(tag) or text
        unseen = tag in _TEXT and self._paint("fill", here) is None and self._paint("stroke", here) is None
        unseen |= here.alpha == 0
        if content and not (unseen or here.style["visibility"] in _HIDDEN):
            raise InputError(
                f"it draws {_FOREIGN[tag]} (<{tag}>); only filled outlines are read: convert it to paths"
            )


def _united(fills: list[_Fill]) -> CrossSection:
    return CrossSection.batch_boolean([fill.region for fill in fills], OpType.Add)


def _seen(fills: list[_Fill], page: Rgb | None, remarks: list[str]) -> CrossSection:
    """Paint the fills one over the other; white ones, and those of the page's colour, are holes where they are opaque.

    page: the colour of a fill of the whole page. Where all is white, white is the shape itself.
    """
    own: set[Rgb | None] = set() if page is None else {page}
    holes = own | {fill.paint.rgb for fill in fills if min(fill.paint.rgb or (0,)) >= WHITE}
    colours = {fill.paint.rgb for fill in fills}
    if colours <= own:
        raise InputError("nothing in it is seen: all fills have the colour of the page")
    if colours <= holes:
        holes = own
    seen, ink = ([fill for fill in fills if fill.paint.rgb not in left_out] for left_out in (own, holes))
    covered = _united(ink).area()
    white = _united(seen).area() - covered
    if white > WHOLE_PAGE * covered:
        remarks.append(f"{white:.4g} mm^2 of white that lie on no other colour are left out")
    return _painted(fills, holes, 0)


def _painted(fills: Iterable[_Fill], holes: set[Rgb | None], depth: int) -> CrossSection:
    """Paint the fills of a group that has `depth` groups around it: its holes are holes in nothing below the group."""
    region = CrossSection()
    for part, same in groupby(fills, lambda fill: fill.groups[depth : depth + 1] or fill.paint.rgb in holes):
        if isinstance(part, tuple):
            region += _painted(same, holes, depth + 1)
        elif part:
            region -= _united([fill for fill in same if fill.paint.alpha >= OPAQUE])
        else:
            region += _united(list(same))
    return region


def _page(declared: Style) -> tuple[FloatArray, tuple[float, float] | None, FloatArray | None]:
    """Give the matrix from user units to mm, y upwards, the viewport in user units and the page's size in mm."""
    box = _view_box(declared)
    sides: list[float | None] = []
    for key in ("width", "height"):
        text = declared.get(key, "auto").strip()
        text = text if "font-size" in declared else re.sub(r"r?em$", "pc", text)  # 16 px either way
        # A share of the window says nothing about mm.
        known = text and text != "auto" and not text.endswith(("%", "vw", "vh"))
        sides.append(PIXEL * _length({key: text}, key, None, 0) if known else None)
        if known and not sides[-1] > 0:  # type: ignore[operator]
            raise InputError(f"its {key} is {short(text)}: it must be positive")
        if re.search(r"\d\s*[a-z]", most := declared.get(f"max-{key}", "")):
            sides[-1] = min(sides[-1] or math.inf, PIXEL * _length({key: most}, key, None, 0))
    width, height = sides
    if box is None:
        view = None if width is None or height is None else (width / PIXEL, height / PIXEL)
        matrix = np.array([[PIXEL, 0, 0], [0, PIXEL, 0]])
    else:
        width = width or (box[2] * height / box[3] if height else box[2] * PIXEL)
        height = height or box[3] * width / box[2]
        view = box[2], box[3]
        matrix = _fit(box, width, height, declared.get("preserveAspectRatio", ""))
    return np.diag([1.0, -1.0]) @ matrix, view, None if view is None else np.array([width, height])


def _view_box(declared: Style) -> tuple[float, float, float, float] | None:
    if not (text := declared.get("viewBox", "").strip()):
        return None
    try:
        x, y, width, height = (float(number) for number in re.split(r"[\s,]+", text))
    except ValueError:
        x = y = width = height = math.nan
    if not (width > 0 and height > 0 and math.isfinite(x + y + width + height)):
        raise InputError(f"its viewBox is {short(text)}; it needs four numbers, the last two positive")
    return x, y, width, height


def _rectangle(declared: Style, view: tuple[float, float] | None) -> tuple[float, float, float, float]:
    """Read x, y, width and height in user units."""
    x, y = (_length(declared, key, view, axis) for axis, key in enumerate(("x", "y")))
    width, height = (_length(declared, key, view, axis) for axis, key in enumerate(("width", "height")))
    return x, y, width, height


def _fit(box: tuple[float, float, float, float], width: float, height: float, ratio: str) -> FloatArray:
    """Fit a viewBox into a width and a height as preserveAspectRatio says: a matrix (2, 3)."""
    scale, spare = np.array([width / box[2], height / box[3]]), np.zeros(2)
    said = re.fullmatch(r"(none|x(Min|Mid|Max)Y(Min|Mid|Max))(\s+(meet|slice))?", ratio.strip())
    if said is None or said[1] != "none":
        scale[:] = scale.max() if said and said[5] == "slice" else scale.min()
        shares = {"Min": 0.0, "Mid": 0.5, "Max": 1.0}
        spare = ([width, height] - scale * box[2:]) * [shares[said[k] if said else "Mid"] for k in (2, 3)]
    return np.column_stack([np.diag(scale), spare - scale * box[:2]])


def _length(declared: Style, key: str, view: tuple[float, float] | None, axis: int) -> float:
    """Read a length in user units, 0 by default; a percentage is of the viewport's side `axis`, 2 for its diagonal."""
    text = declared.get(key, "0").strip()
    match = re.fullmatch(r"([-+]?(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?)\s*(%|[a-z]*)", text, re.IGNORECASE)
    if match is None or match[2].lower() not in {"%", *_UNITS}:
        raise InputError(
            f"its {key} is {short(text)}; a length is a number, or in {', '.join(filter(None, _UNITS))} or %"
        )
    if match[2] != "%":
        return float(match[1]) * _UNITS[match[2].lower()]
    if view is None:
        raise InputError(
            f"its {key} is {short(text)} of a page without a size: give width, height and viewBox"
        )
    return float(match[1]) / 100 * (*view, math.hypot(*view) / math.sqrt(2))[axis]


def _transform(style: Style, view: tuple[float, float] | None) -> FloatArray:
    """Read an SVG or CSS transform about its origin as a matrix (2, 3)."""
    text = style["transform"]
    words = {"left": "0", "top": "0", "center": "50%", "right": "100%", "bottom": "100%"}
    places = (style["transform-origin"].lower().split() + ["center"])[:2]
    if places[0] in ("top", "bottom") or places[1] in ("left", "right"):
        places.reverse()
    x0, y0 = (
        _length({"origin": words.get(place, place)}, "origin", view, axis)
        for axis, place in enumerate(places)
    )
    matrix = np.array([[1.0, 0, x0], [0, 1.0, y0]])
    functions = re.sub(r"\s+\(", "(", text)  # an attribute may have blanks there, CSS may not
    for token in tinycss2.parse_component_value_list(functions, skip_comments=True):
        if token.type == "function":
            matrix = _joined(matrix, _one_transform(token, view))
        elif token.type != "whitespace" and token != ",":
            raise InputError(f"its transform {short(text)} cannot be read")
    return _joined(matrix, np.array([[1.0, 0, -x0], [0, 1.0, -y0]]))


def _one_transform(token: Any, view: tuple[float, float] | None) -> FloatArray:
    """Read one function of a transform as a matrix (2, 3)."""
    name, values = token.lower_name, []
    for part in token.arguments:
        if part.type == "dimension" and part.lower_unit in _ANGLES:
            values.append(part.value * _ANGLES[part.lower_unit])
        elif part.type == "percentage" and name.startswith("scale"):
            values.append(part.value / 100)
        elif part.type != "whitespace" and part != ",":
            axis = 1 if name == "translatey" or values else 0
            values.append(_length({name: part.serialize()}, name, view, axis))
    try:
        return np.array(_TRANSFORMS[name](*values), dtype=float)
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"its transform {token.serialize()[:80]!r} cannot be read") from error


def _rotated(degrees: float, *about: float) -> tuple[tuple[float, ...], ...]:
    x, y = about or (0.0, 0.0)
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    return (c, -s, x - c * x + s * y), (s, c, y - s * x - c * y)


def _skewed(lean: float, lift: float = 0.0) -> tuple[tuple[float, ...], ...]:
    return (1, math.tan(math.radians(lean)), 0), (math.tan(math.radians(lift)), 1, 0)


_TRANSFORMS: dict[str, Callable[..., tuple[tuple[float, ...], ...]]] = {
    "matrix": lambda a, b, c, d, e, f: ((a, c, e), (b, d, f)), "translate": lambda x, y=0.0: ((1, 0, x), (0, 1, y)),
    "translatex": lambda x: ((1, 0, x), (0, 1, 0)), "translatey": lambda y: ((1, 0, 0), (0, 1, y)),
    "scale": lambda x, y=None: ((x, 0, 0), (0, x if y is None else y, 0)), "scalex": lambda x: ((x, 0, 0), (0, 1, 0)),
    "scaley": lambda y: ((1, 0, 0), (0, y, 0)), "rotate": _rotated, "skew": _skewed,
    "skewx": lambda lean: _skewed(lean), "skewy": lambda lift: _skewed(0.0, lift),
}  # fmt: skip


def _joined(outer: FloatArray, inner: FloatArray) -> FloatArray:
    """Apply `inner` and then `outer`: matrices (2, 3)."""
    return outer @ np.vstack([inner, [0, 0, 1]])


def _link(attributes: dict[str, str]) -> str:
    link = next((attributes[key] for key in _HREFS if key in attributes), "")
    return unquote(link.strip().removeprefix("#"))


def _is_shown(element: Element) -> bool:
    """Tell whether an element may be drawn, in English and without extensions; not a comment, nor an editor's notes."""
    languages = element.get("systemLanguage", "en").lower().split(",")
    return (
        element.tag in _DRAWN
        and element.get("requiredExtensions") is None
        and any(language.strip().split("-")[0] == "en" for language in languages)
    )


def _path_data(tag: str, declared: Style, view: tuple[float, float] | None) -> str:
    """Write a shape as path data, in user units; empty if it has no size."""
    if tag == "path":
        if declared["d"] == "none" or "\\" not in declared["d"]:
            return declared["d"].removeprefix("none")[len('path("') : -len('")')]
        function: Any = tinycss2.parse_one_component_value(declared["d"])  # with escapes, as of line ends
        return str(next(token.value for token in function.arguments if token.type == "string"))
    if tag in ("polygon", "polyline"):
        if not _POINTS.fullmatch(points := declared.get("points", "")):
            raise ValueError("something else between the points")
        return f"M{points}z" if points else ""

    given = {key: value for key, value in declared.items() if value != "auto"}
    declared = {"rx": "-1", "ry": "-1"} | given
    rx, ry = (_length(declared, key, view, axis) for axis, key in enumerate(("rx", "ry")))
    rx, ry = rx if rx >= 0 else max(ry, 0.0), ry if ry >= 0 else max(rx, 0.0)
    if tag == "circle":
        rx = ry = _length(declared, "r", view, 2)
    if tag == "rect":
        x, y, width, height = _rectangle(declared, view)
        rx, ry = min(rx, width / 2), min(ry, height / 2)
    else:
        x, y = _length(declared, "cx", view, 0) - rx, _length(declared, "cy", view, 1) - ry
        width, height = 2 * rx, 2 * ry
    if not (width > 0 and height > 0) or tag == "line":
        return ""
    right, low = x + width, y + height
    arc = f"A{rx!r} {ry!r} 0 0 1"
    return (
        f"M{x + rx!r} {y!r}H{right - rx!r}{arc} {right!r} {y + ry!r}V{low - ry!r}{arc} {right - rx!r} {low!r}"
        f"H{x + rx!r}{arc} {x!r} {low - ry!r}V{y + ry!r}{arc} {x + rx!r} {y!r}z"
    )


def _subpaths(data: str) -> list[list[Any]]:
    """Part path data into runs of segments that start with a move and go on."""
    runs: list[list[Any]] = []
    if re.search(r",\s*,", data):
        raise ValueError("two commas in a row")
    for segment in _parser.parse_path(data):
        if isinstance(segment, Move):
            runs.append([])
        elif not runs:
            raise InputError("an outline in it does not begin with a move (M)")
        runs[-1].append(segment)
    return [run for run in runs if len(run) > 1]


def _chords(segments: list[Any], matrix: FloatArray, flattening: float) -> FloatArray:
    """Flatten a run of lines, Bezier curves and arcs into corners (k, 2) mm; chords are off by `flattening` at most."""
    corners = []
    for segment in segments[1:]:
        count = 1.0
        if not isinstance(segment, Linear):
            # A chord is off by its length^2 curvature / 8, and second differences are what a curve bends.
            bends = np.diff(_points_along(segment, _SAMPLES, matrix), n=2, axis=0)
            count = _SAMPLES * math.sqrt(float(np.hypot(*bends.T).max()) / (8 * flattening))
        corners.append(_points_along(segment, max(math.ceil(min(count, MOST_IN_OUTLINE + 1)), 1), matrix)[1:])
    flat = np.concatenate([_points_along(segments[0], 1, matrix)[1:], *corners])
    if not np.isfinite(flat).all() or np.abs(flat).max() > LARGEST:
        raise InputError(f"a corner lies more than {LARGEST:g} mm from the drawing's origin")
    return flat


def _points_along(segment: Any, count: int, matrix: FloatArray) -> FloatArray:
    """Give count + 1 points of a segment, evenly in its parameter: (count + 1, 2) mm."""
    points = np.array([complex(segment.point(k / count)) for k in range(count + 1)])
    return np.stack([points.real, points.imag], axis=1) @ matrix[:, :2].T + matrix[:, 2]
