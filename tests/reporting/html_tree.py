"""A page as a tree of elements, for tests of its structure."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from html.parser import HTMLParser

_VOID = {"meta", "br", "img", "link", "input", "hr"}


@dataclass(eq=False)
class Element:
    """An element with its attributes, children and own text."""

    tag: str
    attributes: dict[str, str] = field(default_factory=dict)
    parent: Element | None = None
    children: list[Element | str] = field(default_factory=list)

    def every(self, tag: str, klass: str = "") -> Iterator[Element]:
        """Yield the elements of a tag, and of a class where it is given, inside this one, in order."""
        for child in self.children:
            if isinstance(child, Element):
                if child.tag == tag and (not klass or klass in child.attributes.get("class", "").split()):
                    yield child
                yield from child.every(tag, klass)

    def everything(self) -> Iterator[Element]:
        """Yield all elements inside this one."""
        for child in self.children:
            if isinstance(child, Element):
                yield child
                yield from child.everything()

    def inside(self, tag: str) -> bool:
        """Return whether an element of this tag is around this one."""
        return self.parent is not None and (self.parent.tag == tag or self.parent.inside(tag))

    @property
    def text(self) -> str:
        """All text inside but scripts and styles, with single spaces."""
        parts = [
            child if isinstance(child, str) else "" if child.tag in ("script", "style") else child.text
            for child in self.children
        ]
        return " ".join(" ".join(parts).split())


class _Parser(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.root = self.at = Element("root")

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        made = Element(tag, {name: value or "" for name, value in attrs}, self.at)
        self.at.children.append(made)
        if tag not in _VOID:
            self.at = made

    def handle_endtag(self, tag: str) -> None:
        assert self.at.tag == tag, f"</{tag}> closes <{self.at.tag}>"
        assert self.at.parent is not None
        self.at = self.at.parent

    def handle_data(self, data: str) -> None:
        self.at.children.append(data)


def tree(page: str) -> Element:
    """Return a page as a tree; a tag that is not closed, or in the wrong order, is an `AssertionError`."""
    parser = _Parser()
    parser.feed(page)
    assert parser.at is parser.root, f"<{parser.at.tag}> is not closed"
    return parser.root
