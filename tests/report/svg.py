"""What the tests of pictures read from SVG."""

from xml.etree import ElementTree


def parse(svg: str) -> ElementTree.Element:
    assert svg
    return ElementTree.fromstring(svg)


def select_class(root: ElementTree.Element, *names: str) -> list[ElementTree.Element]:
    return [e for e in root.iter() if set(names) <= set(e.get("class", "").split())]


def list_texts(root: ElementTree.Element) -> list[str]:
    return [e.text or "" for e in root.iter("text")]
