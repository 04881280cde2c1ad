"""Robot files with something wrong: real ones whose elements, attributes or bytes were changed."""

from __future__ import annotations

import copy
from functools import cache
from pathlib import Path
from typing import Any

from hypothesis import strategies as st
from lxml import etree

ROBOTS = Path(__file__).parents[2] / "robots"
EVERYTHING = Path(__file__).with_name("everything.xml")
WORDS = (
    "", " ", "0", "-1", "1e308", "-1e308", "1e-320", "nan", "inf", "-inf", "1e999", "99999999999", "2147483648",
    "-2147483649", "0 0 0", "1 2", "1 2 3 4 5 6 7 8 9", "true", "false", "auto", "world", "main", "a", "../a",
    "/etc/passwd", "a/b", "a\\b", "a b", "é漢😀", "'\"&<>", "x" * 300, "%s%n", "{}", "$(find x)", "package://x/y.stl",
    "model://", "file:///etc/passwd", "a.stl", "a.obj", "a.png", "hinge", "ball", "free", "slide", "mesh", "sphere",
    "fixed", "revolute", "floating", "planar",
)  # fmt: skip
TAGS = (
    "body", "joint", "freejoint", "geom", "site", "camera", "frame", "default", "replicate", "attach", "inertial",
    "plugin", "tendon", "spatial", "fixed", "actuator", "motor", "position", "sensor", "equality", "weld", "key",
    "keyframe", "compiler", "mesh", "hfield", "texture", "material", "flexcomp", "composite", "skin", "exclude",
    "pair", "mocap", "include", "model", "link", "origin", "axis", "limit", "mimic", "parent", "child",
    "transmission", "gazebo", "ros2_control", "collision",
)  # fmt: skip
BYTES = (
    b"\0",
    b"<",
    b">",
    b'"',
    b"&",
    b"&#0;",
    b"&#x110000;",
    b"\xff",
    b"\xef\xbb\xbf",
    b"<!DOCTYPE a>",
    b"<![CDATA[",
    b"-->",
    b"\r",
)


@cache
def seeds() -> tuple[bytes, ...]:
    """The shipped robots, and a file with a little of everything that MJCF knows."""
    shipped = sorted([*ROBOTS.glob("*/*.xml"), *ROBOTS.glob("*/*.urdf")])
    return (*(path.read_bytes() for path in shipped), EVERYTHING.read_bytes())


@st.composite
def broken_files(draw: st.DrawFn) -> bytes:
    """The bytes of a robot file after one to five changes."""
    source = draw(st.sampled_from(seeds()))
    root = etree.fromstring(source)
    names = sorted({name for element in root.iter("*") for name in element.attrib.values() if len(name) < 40})
    for _ in range(draw(st.sampled_from((1, 1, 1, 2, 2, 3, 5)))):
        _change(draw, root, names)
    source = etree.tostring(root, encoding="utf-8")
    for _ in range(draw(st.sampled_from((0, 0, 0, 0, 0, 0, 0, 0, 0, 1)))):
        at = draw(st.integers(0, len(source)))
        source = source[:at] + draw(st.sampled_from(BYTES)) + source[at + draw(st.integers(0, 4)) :]
    return source


def _change(draw: st.DrawFn, root: Any, names: list[str]) -> None:
    elements = list(root.iter("*"))
    element = elements[draw(st.integers(0, len(elements) - 1))]
    other = elements[draw(st.integers(0, len(elements) - 1))]
    how = draw(st.sampled_from(("set", "set", "swap", "drop", "remove", "copy", "move", "rename", "nest", "text")))
    keys = sorted(element.attrib)
    value = draw(st.one_of(st.sampled_from(WORDS), st.sampled_from(names or ["a"]), st.sampled_from(WORDS)))
    if how == "set" and keys:
        element.set(draw(st.sampled_from(keys)), value)
    elif how == "swap" and keys and other.attrib:
        element.set(draw(st.sampled_from(keys)), other.get(draw(st.sampled_from(sorted(other.attrib)))))
    elif how == "drop" and keys:
        del element.attrib[draw(st.sampled_from(keys))]
    elif how == "remove" and element is not root:
        element.getparent().remove(element)
    elif how == "copy":
        other.append(copy.deepcopy(element))
    elif (
        how == "move" and element is not root and not any(above is element for above in (other, *other.iterancestors()))
    ):
        other.append(element)
    elif how == "rename" and element is not root:
        element.tag = draw(st.sampled_from(TAGS))
    elif how == "nest":
        etree.SubElement(
            element, draw(st.sampled_from(TAGS)), {draw(st.sampled_from(("name", "file", "type", "size"))): value}
        )
    elif how == "text":
        element.text = value
