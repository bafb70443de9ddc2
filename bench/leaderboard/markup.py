"""Make HTML from elements, so that no text from a file can become markup."""

from __future__ import annotations

from xml.etree.ElementTree import Element, tostring

from tactsim.core.errors import printable

Child = Element | str | None


def h(tag: str, attributes: dict[str, str] | None = None, *children: Child) -> Element:
    """Make an element. Children that are text stay text, whatever they hold; None is left out."""
    made = Element(tag, {name: printable(value) for name, value in (attributes or {}).items()})
    last: Element | None = None
    for child in children:
        if isinstance(child, Element):
            made.append(child)
            last = child
        elif child is not None and last is None:
            made.text = (made.text or "") + printable(child)
        elif child is not None and last is not None:
            last.tail = (last.tail or "") + printable(child)
    return made


def block(title: str, *children: Child) -> Element:
    """Make a part of a page with its heading."""
    return h("section", {"class": "block"}, h("h2", {}, title), *children)


def scrolling(label: str, table: Element) -> Element:
    """Let a wide table scroll sideways by itself, so that the page never does."""
    return h("div", {"class": "scroll", "tabindex": "0", "role": "region", "aria-label": label}, table)


def html(*elements: Element) -> str:
    """Write elements as HTML."""
    return "\n".join(tostring(one, encoding="unicode", method="html") for one in elements)
