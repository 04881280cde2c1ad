"""Facts about MJCF's elements and attributes: what refers to what, what names files, what multiplies bodies."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

EXPANDERS = ("attach", "replicate", "composite", "flexcomp")
"""Elements of which MuJoCo makes bodies that the file does not spell out."""

REFERENCES = {
    "body": ("body", "body1", "body2", "subtree1", "subtree2", "node", "target"),
    "joint": ("joint", "joint1", "joint2", "jointinparent"),
    "geom": ("geom", "geom1", "geom2"),
    "site": ("site", "site1", "site2", "refsite", "slidersite", "cranksite", "sidesite"),
    "camera": ("camera",),
    "tendon": ("tendon", "tendon1", "tendon2"),
    "actuator": ("actuator",),
    "flex": ("flex",),
    "mesh": ("mesh",),
    "material": ("material",),
    "texture": ("texture",),
    "hfield": ("hfield",),
}
"""Kind of element -> the attributes that name one of that kind."""

OBJECTS = {"objtype": "objname", "reftype": "refname"}
"""Attribute that says the kind -> attribute that names the element."""

ASSETS = ("mesh", "hfield", "material", "texture")
"""Assets that other elements name."""

NAMED_BY_FILE = ("mesh", "hfield", "texture", "skin")
"""Assets that are called by their file where they have no name."""

TEXTURE_FILES = ("file", "fileback", "filedown", "filefront", "fileleft", "fileright", "fileup")
"""Attributes of a texture that name files."""

FILE_FOLDERS = {
    "mesh": "meshdir", "hfield": "meshdir", "skin": "meshdir", "flexcomp": "meshdir", "texture": "texturedir",
}  # fmt: skip
"""Element that names a file -> the `<compiler>` setting for the folder that the name starts in."""

_SOUGHT_IN = {"mesh": "meshdir", "texture": "texturedir", "hfield": "assetdir", "skin": "assetdir"}
_FLEXCOMP_FILES = ("mesh", "gmsh")

FILE_SETTINGS = ("meshdir", "texturedir", "assetdir", "strippath")
"""`<compiler>` settings that change what names of files mean."""

_KIND_OF = {attribute: kind for kind, attributes in REFERENCES.items() for attribute in attributes}
_LISTS = {("flex", "body"), ("flex", "node")}


def references(element: Any) -> Iterator[tuple[str, str]]:
    """Kind and name of everything that an element names, its children aside.

    An `xbody` counts as the body that it is of; a kind can be one that is not in `REFERENCES`.
    """
    for attribute, value in element.attrib.items():
        kind = _KIND_OF.get(attribute)
        if kind is not None:
            for name in value.split() if (element.tag, attribute) in _LISTS else [value]:
                yield kind, name
    for kind_attribute, name_attribute in OBJECTS.items():
        name = element.get(name_attribute)
        if name is not None:
            yield element.get(kind_attribute, "").replace("xbody", "body"), name


def file_folder(root: Any, setting: str) -> str:
    """What a file's `meshdir` or `texturedir` is; several `<compiler>` sections count as one, the last one first."""
    folder = ""
    for compiler in root.iterfind("compiler"):
        folder = compiler.get(setting, compiler.get("assetdir", folder))
    return str(folder)


def sought_folder(root: Any, tag: str) -> str:
    """The folder that MuJoCo looks into before it looks beside an included file that has an element of a tag."""
    found = {key: value for each in root.iterfind("compiler") for key, value in each.attrib.items()}
    setting = _SOUGHT_IN.get(tag)
    return "" if setting is None else str(found.get(setting, found.get("assetdir", "")))


def reads_file(element: Any) -> bool:
    """Whether MuJoCo reads the files that an element names; some it makes itself."""
    if element.tag == "flexcomp":
        return element.get("type") in _FLEXCOMP_FILES
    return element.tag != "texture" or element.get("builtin", "none") == "none"


def strips_paths(root: Any) -> bool:
    """Whether only the last part of a file's name counts."""
    strip = "false"
    for compiler in root.iterfind("compiler"):
        strip = compiler.get("strippath", strip)
    return strip == "true"


def drop_file_settings(root: Any) -> bool:
    """Let names of files mean what they say, seen from the file's folder; whether they did not before."""
    dropped = [each.attrib.pop(key, None) for each in root.iter("compiler") for key in FILE_SETTINGS]
    return any(value is not None for value in dropped)
