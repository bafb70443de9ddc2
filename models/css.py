"""What an SVG drawing declares of its elements: attributes, style sheets and styles, by the CSS cascade."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any, NamedTuple
from urllib.parse import unquote
from xml.etree.ElementTree import Element

import tinycss2
from cssselect2 import ElementWrapper, Matcher, SelectorError, compile_selector_list
from tinycss2.color4 import parse_color

from tactsim.core.errors import InputError, short

SVG = "{http://www.w3.org/2000/svg}"
_XHTML = "{http://www.w3.org/1999/xhtml}"  # whose sheets count in a drawing, too

Style = dict[str, str]
Rgb = tuple[int, int, int]
_Selected = tuple[Any, list[tuple[str, str, bool]]]  # a selector, and what it declares

# Properties that children take over, and those that they do not, with what holds where nothing is declared.
_INHERITED = {
    "fill": "black", "fill-rule": "nonzero", "fill-opacity": "1", "clip-rule": "nonzero", "visibility": "visible",
    "color": "black", "stroke": "none", "stroke-width": "1", "stroke-opacity": "1", "marker-start": "none",
    "marker-mid": "none", "marker-end": "none", "marker": "none",
}  # fmt: skip
_OWN = {
    "display": "inline", "opacity": "1", "clip-path": "none", "mask": "none", "mask-type": "luminance",
    "filter": "none", "transform": "none", "transform-origin": "0 0", "transform-box": "view-box",
    "translate": "none", "rotate": "none", "scale": "none", "overflow": "hidden", "stop-color": "black",
    "stop-opacity": "1", "mix-blend-mode": "normal", "d": "none",
}  # fmt: skip
# Lengths are properties too, since SVG 2. Sizes have no sign.
_SIZES = {"r", "rx", "ry", "width", "height"}
_LENGTHS = {"x", "y", "cx", "cy", *_SIZES}
_PROPERTIES = {*_INHERITED, *_OWN, *_LENGTHS, "font-size", "max-width", "max-height"}
# Where inner pages lie and how large clones are is said by attributes only, as Chromium reads it.
_BY_ATTRIBUTE = {
    f"{SVG}svg": ("x", "y", "width", "height"), f"{SVG}symbol": ("x", "y", "width", "height"),
    f"{SVG}use": ("width", "height"),
}  # fmt: skip
# Properties that can change an outline, and are not read.
_UNREAD = re.compile(r"all|mask-(image|mode|composite|border.*)|offset(-path)?|(block|inline)-size")
_OF_ALL = ("inherit", "initial", "unset", "revert")  # values of every property
_PATH = re.compile(r"\s*([Mm][MmZzLlHhVvCcSsQqTtAaEe\d\s,.+-]*)?")
# What a transform is in an attribute: a number there has no unit, unlike in a style.
_TRANSFORM = re.compile(r"\s*((matrix|translate|scale|rotate|skew[XY])\s*\([-+.,\deE\s]*\)\s*(,\s*)?)*")
# Media for which rules count, and those for which they do not: a drawing is read as on a bright screen.
_SHOWN = re.compile(r"(only )?(all|screen)?( and )?(\(prefers-color-scheme: ?light\))?")
_NOT_SHOWN = re.compile(r"(only )?(print|(all|screen)?( and )?\(prefers-color-scheme: ?dark\)).*|not all")
_OF_PLACES = ("translate", "rotate", "skew")  # transforms of lengths and angles
ELSEWHERE = "it takes a style sheet from elsewhere"
_CONDITIONS = ("media", "supports", "layer", "container", "scope")
# Paints that browsers know, and this reader does not.
_UNREAD_PAINT = re.compile(
    r"(color-mix|light-dark|contrast-color)\(.*|[\w-]+\((\s*from\s|.*calc\().*"
    r"|(canvas|field|highlight|mark|button\w+|accent\w+)"
)
_VARIABLE = re.compile(r"var\(\s*(--[\w-]+)\s*(?:,((?:[^()]|\([^()]*\))*))?\)")
_MOST_VARIABLES = 8  # that stand for one another


class Paint(NamedTuple):
    """What fills or strokes an outline. rgb: red, green, blue, 0 to 255; None for a gradient of several colours."""

    rgb: Rgb | None
    alpha: float


def declarations(root: Element) -> dict[Element, Style]:
    """Collect what is declared of each element, the strongest of each property: attributes, sheets, its own style."""
    matcher = Matcher()
    for element in root.iter():
        if element.tag == f"{_XHTML}link" and "stylesheet" in element.get("rel", "").lower().split():
            raise InputError(f"{ELSEWHERE}, <link>: put that into a <style>")
        if element.tag in (f"{SVG}style", f"{_XHTML}style") and element.get("type", "").lower() in (
            "",
            "text/css",
        ):
            text = (element.text or "") + "".join(child.tail or "" for child in element)
            sheet = tinycss2.parse_stylesheet(text, True, True)
            shown = _if_shown("media", element.get("media", ""), _selected(sheet, _namespaces(sheet)))
            for selector, rules in shown:
                matcher.add_selector(selector, rules)
    declared = {}
    for wrapped in ElementWrapper.from_xml_root(root).iter_subtree():
        element = wrapped.etree_element
        rules = [rule for *_, pseudo, rules in matcher.match(wrapped) if pseudo is None for rule in rules]
        own = list(_rules(tinycss2.parse_blocks_contents(element.get("style", "")), in_sheet=False))
        values = {name: re.sub(r"/\*.*?\*/", "", value).strip() for name, value in element.attrib.items()}
        for name in _PROPERTIES & values.keys():
            wrong = name == "transform" and not _TRANSFORM.fullmatch(values[name])
            if "var(" not in values[name] and (wrong or not _is_valid(name, values[name])):
                del values[name]
        if values.get("d", "none") != "none":
            values["d"] = f'path("{values["d"]}")'  # as a style says it
        fixed = () if element is root else _BY_ATTRIBUTE.get(element.tag, ())
        counted = [rule for rule in rules + own if rule[0] not in fixed]
        for important in (False, True):
            values |= {name: value for name, value, strong in counted if strong is important}
        declared[element] = values
    return declared


def computed(declared: Style, parent: Style) -> Style:
    """Compute an element's properties, and its variables, from what is declared of it and from its parent's."""
    style = {name: value for name, value in (parent | declared).items() if name.startswith("--")}
    for name, initial in (_INHERITED | _OWN).items():
        value = declared.get(name, "unset")
        for _ in range(_MOST_VARIABLES if "var(" in value else 0):
            value = _VARIABLE.sub(lambda match: style.get(match[1], match[2] or ""), value).strip()
        value = value if "(" in value else value.lower()
        if value in ("unset", "revert") or not _is_valid(name, value):
            value = "inherit" if name in _INHERITED else "initial"
        style[name] = {"inherit": parent.get(name, initial), "initial": initial}.get(value, value)
    return style


def share(text: str) -> float:
    """Read an opacity, a number or a percentage, as 0 to 1; 1 for what is neither."""
    token = tinycss2.parse_one_component_value(text, skip_comments=True)
    if token.type not in ("number", "percentage"):
        return 1.0
    return min(max(token.value / (100 if token.type == "percentage" else 1), 0.0), 1.0)


def url_in(text: str) -> tuple[str | None, str]:
    """Part `url(#name) rest` into name and rest; the name is None for what is no link."""
    tokens = tinycss2.parse_component_value_list(text, skip_comments=True)
    first = tokens[0] if tokens else None
    if first is not None and first.type == "url":
        link = first.value
    elif first is not None and first.type == "function" and first.lower_name == "url":
        link = first.arguments[0].value if first.arguments else ""
    else:
        return None, text
    return unquote(link.strip().removeprefix("#")), tinycss2.serialize(tokens[1:]).strip()


def color(text: str, style: Style) -> Paint | None:
    """Read a colour; None if it is none, or not valid."""
    first = next(iter(tinycss2.parse_component_value_list(text, skip_comments=True)), "")
    parsed = parse_color(first)
    if parsed == "currentcolor":
        parsed = parse_color(style["color"])
    if parsed is None or isinstance(parsed, str):
        return None
    if parsed.space in ("hsl", "hwb"):
        parsed = parsed.to("srgb")
    values = parsed.coordinates  # of red, green and blue of any kind: white is 1, 1, 1
    if "rgb" not in parsed.space and parsed.space not in ("display-p3", "rec2020"):
        light, *hues = parsed.to("lab").coordinates  # white stays white, and other colours differ
        values = (light / 100, *(light / 100 + hue / 500 for hue in hues))
    red, green, blue = (round(255 * (value or 0)) for value in values)
    return Paint((red, green, blue), parsed.alpha)


def _namespaces(sheet: list[Any]) -> dict[str | None, str]:
    """Read the names that a sheet gives to namespaces, None for its default. Raises InputError for another sheet."""
    names: dict[str | None, str] = {}
    for rule in sheet:
        if rule.type != "at-rule" or rule.lower_at_keyword not in ("charset", "import", "layer", "namespace"):
            break
        words = [token for token in rule.prelude if token.type not in ("whitespace", "comment")]
        link = (
            words[-1].value
            if words and words[-1].type == "string"
            else url_in(tinycss2.serialize(words[-1:]))[0]
        )
        if rule.lower_at_keyword == "import" and "font" not in (
            text := tinycss2.serialize(rule.prelude).lower()
        ):
            raise InputError(f"{ELSEWHERE}, @import {short(text.strip())}: put that into a <style>")
        if rule.lower_at_keyword == "namespace" and link is not None:
            names[words[0].value if words[0].type == "ident" else None] = link
    if names.get(None, SVG[1:-1]) != SVG[1:-1]:
        raise InputError(f"the @namespace of its style sheet is {short(names[None])}, not SVG's: take it out")
    return names


def _selected(rules: list[Any], namespaces: dict[str | None, str], around: str = "") -> Iterator[_Selected]:
    """Give each selector of a sheet, or of what a rule with the selectors `around` nests, and what it declares."""
    for rule in rules:
        if rule.type == "at-rule" and rule.lower_at_keyword in _CONDITIONS and rule.content is not None:
            content = tinycss2.serialize(rule.content)
            content = f"&{{{content}}}" if around else content  # with declarations of what is around
            inner = _selected(tinycss2.parse_rule_list(content, True, True), namespaces, around)
            yield from _if_shown(rule.lower_at_keyword, tinycss2.serialize(rule.prelude), inner)
        elif rule.type == "at-rule" and rule.content is not None:
            named = re.findall(r"([\w-]+)\s*:", tinycss2.serialize(rule.content).lower())
            if rule.lower_at_keyword.endswith(("keyframes", "property")) and {*named} & {
                *_PROPERTIES,
                "initial-value",
            }:
                raise InputError(
                    f"its style sheet has @{rule.lower_at_keyword}, which is not read: take that rule out"
                )
        elif rule.type == "qualified-rule":
            text = tinycss2.serialize(rule.prelude)
            if around:
                text = (text if "&" in text else f"& {text}").replace("&", f":is({around})")
            content = tinycss2.parse_blocks_contents(rule.content, True, True)
            declared = list(_rules(content))
            selectors, unread = [], re.search(r":(any-)?link\b|:lang\(", text)
            try:
                selectors = compile_selector_list(text, namespaces)
            except SelectorError:  # without a pseudo-class, no renderer knows it
                unread = unread or re.search(r"(?<!:):[a-z]", text)
            if unread and declared:
                raise InputError(
                    f"its style sheet selects {short(text.strip())}, which is not read: take that rule out"
                )
            yield from ((selector, declared) for selector in selectors if declared)
            yield from _selected(content, namespaces, text)


def _if_shown(keyword: str, condition: str, selected: Iterator[_Selected]) -> Iterator[_Selected]:
    """Give what is declared under a condition if it holds; refuse a drawing of which the reader decides."""
    queries = [" ".join(query.lower().split()) for query in condition.split(",")]
    if keyword == "media" and any(_SHOWN.fullmatch(query) for query in queries):
        yield from selected
    elif (keyword != "media" or not all(map(_NOT_SHOWN.fullmatch, queries))) and [*selected]:
        what = short(f"@{keyword} {condition.strip()}")
        raise InputError(f"its style sheet shows something else under {what}: take that rule out")


def _rules(content: list[Any], in_sheet: bool = True) -> Iterator[tuple[str, str, bool]]:
    """Give the declarations that an outline depends on: name, value and whether it is important."""
    for part in content:
        if part.type != "declaration":
            continue
        name = part.name if part.name.startswith("--") else part.lower_name.removeprefix("-webkit-")
        value = tinycss2.serialize(part.value).strip()
        if _UNREAD.fullmatch(name) and value.lower() not in ("none", "auto", "initial"):
            raise InputError(f"its style declares {name}, which is not read: say in other words what it does")
        known = name in _PROPERTIES or name.startswith("--")
        if known and ("var(" in value or (_is_valid(name, value) and _has_units(name, part.value, in_sheet))):
            yield name, value, part.important


def _has_units(name: str, value: list[Any], in_sheet: bool) -> bool:
    """Tell whether a length, an angle or an outline counts that a style declares, where an attribute would be laxer.

    As browsers do: widths and heights in a sheet need a unit unless they are 0, and so do arguments of transforms; a
    size has no sign.
    """
    tokens = [token for token in value if token.type not in ("whitespace", "comment")]
    if not tokens:
        return False
    if name in _LENGTHS:
        if len(tokens) != 1 or tokens[0].type not in ("number", "dimension", "percentage"):
            words = [token.lower_value for token in tokens if token.type == "ident"]
            return {*words} <= {"auto", *_OF_ALL} and len(words) + any(
                t.type == "function" for t in tokens
            ) == 1
        bare = in_sheet and name in ("width", "height") and tokens[0].type == "number" and tokens[0].value
        return not bare and (name not in _SIZES or tokens[0].value >= 0)
    if name == "d" and tokens[0].type == "function":
        inner = [token for token in tokens[0].arguments if token.type not in ("whitespace", "comment")]
        text = len(tokens) == len(inner) == 1 and tokens[0].lower_name == "path" and inner[0].type == "string"
        return text and _PATH.fullmatch(inner[0].value) is not None
    if name == "d":
        return len(tokens) == 1 and tokens[0].type == "ident" and tokens[0].lower_value in ("none", *_OF_ALL)
    if name == "transform":
        tokens = [
            part for token in tokens if token.type == "function" and token.lower_name.startswith(_OF_PLACES)
            for part in token.arguments
        ]  # fmt: skip
    elif name != "transform-origin":
        return True
    return not any(token.type == "number" and token.value for token in tokens)


def _is_valid(name: str, value: str) -> bool:
    """Tell whether a property's value counts: nothing, and a paint that is not valid, do not."""
    words = ("none", "inherit", "initial", "unset", "context-fill", "context-stroke")
    paint = name not in ("fill", "stroke", "color") or value.lower() in words[name == "color" :]
    if not paint and _UNREAD_PAINT.fullmatch(value.lower()):
        raise InputError(f"its {name} is {short(value)}, which is not read: write it as #rrggbb")
    return bool(value) and (paint or url_in(value)[0] is not None or parse_color(value) is not None)
