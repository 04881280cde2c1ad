"""Our facts about MJCF compared with the schema that MuJoCo itself prints."""

from __future__ import annotations

import re
from collections.abc import Iterator

import mujoco
import pytest
from lxml import etree

from morphkit.formats.mjcf_schema import (
    ASSETS,
    EXPANDERS,
    FILE_FOLDERS,
    FILE_SETTINGS,
    OBJECTS,
    REFERENCES,
    TEXTURE_FILES,
    file_folder,
    references,
    strips_paths,
)

UNLISTED = {"composite", "replicate"}
"""Elements that MuJoCo replaces before it looks at its schema."""


def schema() -> Iterator[tuple[str, set[str]]]:
    """Element and attributes, as often as the schema lists the element; attributes go on over several lines."""
    element, attributes = "", set[str]()
    for line in mujoco.mj_printSchema(False, False).splitlines():
        start = re.match(r"\s*(\(world\)body|\w+) \([!?*R]\)\s*(.*)", line)
        if start:
            yield element, attributes
            element, attributes = start[1].removeprefix("(world)"), set(start[2].split())
        else:
            attributes |= set(line.split())
    yield element, attributes


ELEMENTS = list(schema())
ATTRIBUTES = {attribute for _, attributes in ELEMENTS for attribute in attributes}
REFERRING = {attribute for attributes in REFERENCES.values() for attribute in attributes}


def test_every_reference_exists_in_the_schema() -> None:
    assert len(ELEMENTS) > 100
    assert REFERRING <= ATTRIBUTES
    assert {*OBJECTS, *OBJECTS.values()} <= ATTRIBUTES


def test_every_attribute_that_is_called_like_a_kind_is_a_reference() -> None:
    kinds = "|".join(REFERENCES)
    alike = {each for each in ATTRIBUTES if re.fullmatch(rf"(ref|slider|crank|side)?({kinds})(inparent)?\d?", each)}
    sizes_and_flags = {"actuator", "sensor"} - REFERRING
    assert alike - sizes_and_flags == REFERRING - {"subtree1", "subtree2", "node", "target"}


def test_every_attribute_that_names_a_file_of_an_asset_is_known() -> None:
    naming = {(tag, each) for tag, attributes in ELEMENTS for each in attributes if re.fullmatch("file[a-z]*", each)}
    assert {each for tag, each in naming if tag == "texture"} == set(TEXTURE_FILES)
    others = {tag for tag, _ in naming} - {"include", "model"}
    assert others == set(FILE_FOLDERS)


def test_expanders_assets_and_settings_exist_in_the_schema() -> None:
    tags = {tag for tag, _ in ELEMENTS}
    assert {*EXPANDERS, *ASSETS} - UNLISTED <= tags
    settings = {each for tag, attributes in ELEMENTS if tag == "compiler" for each in attributes}
    assert set(FILE_SETTINGS) <= settings


@pytest.mark.parametrize(
    ("xml", "named"),
    [
        ("<flex body='a b' node='c'/>", [("body", "a"), ("body", "b"), ("body", "c")]),
        ("<exclude body1='a' body2='b'/>", [("body", "a"), ("body", "b")]),
        ("<framepos objtype='xbody' objname='a' reftype='site' refname='s'/>", [("body", "a"), ("site", "s")]),
        ("<contact site='s' subtree1='a'/>", [("site", "s"), ("body", "a")]),
        ("<geom name='body' mesh='m' material='red'/>", [("mesh", "m"), ("material", "red")]),
    ],
)
def test_references(xml: str, named: list[tuple[str, str]]) -> None:
    assert list(references(etree.fromstring(xml))) == named


@pytest.mark.parametrize(
    ("compilers", "folder"),
    [
        ("", ""),
        ("<compiler assetdir='a'/>", "a"),
        ("<compiler assetdir='a' meshdir='m'/>", "m"),
        ("<compiler meshdir='m'/><compiler assetdir='a'/>", "a"),
        ("<compiler meshdir='m'/><compiler strippath='true'/>", "m"),
    ],
)
def test_the_last_compiler_section_says_where_meshes_are(compilers: str, folder: str) -> None:
    text = f"<mujoco>{compilers}<worldbody><body><geom size='1'/></body></worldbody></mujoco>"
    root = etree.fromstring(text)
    assert file_folder(root, "meshdir") == folder == mujoco.MjSpec.from_string(text).meshdir.rstrip("/")
    assert strips_paths(root) == ("true" in compilers)
