"""Names of elements that have none in an MJCF file: what the reader calls them, and how a cut leaves it so."""

from __future__ import annotations

import copy
import re
from collections.abc import Iterator, Sequence
from typing import Any

import mujoco
from lxml import etree

from morphkit.ablation.loss import Loss
from morphkit.description import Description
from morphkit.formats.mjcf_attach import prepare_parse
from morphkit.formats.mjcf_names import name_elements

Given = list[tuple[Any, str | None]]
"""Elements without a name and what the reader calls them; None for those that are templates of several."""

_MARK = "morphkit/unnamed/"
_COUNTED = re.compile(r"_\d+$")


def unnamed(root: Any) -> list[Any]:
    """The `<body>`, joint, actuator and sensor elements below `<mujoco>` that have no name."""
    found = [each for world in root.iterfind("worldbody") for each in world.iter("body", "joint", "freejoint")]
    found += [each for section in ("actuator", "sensor") for each in root.iterfind(f"{section}/*")]
    return [each for each in found if not each.get("name")]


def given_names(root: Any, description: Description) -> Given:
    """Names of all elements below `root`, the tree of `description`, that have none.

    Raises:
        ValueError: MuJoCo, which says what else there is, cannot parse the file.
    """
    elements = unnamed(root)
    if not elements:
        return []
    tree = etree.ElementTree(copy.deepcopy(root))
    for number, twin in enumerate(unnamed(tree.getroot())):
        twin.set("name", f"{_MARK}{number}/")  # so that it is found again in what MuJoCo makes of the file
    spec = parse_tree(tree, description)
    marked = {}
    for each in _named_kinds(spec):
        if each.name.startswith(_MARK):
            marked[each.name.removeprefix(_MARK)] = each
            each.name = ""
    name_elements(spec)
    names = {mark: each.name for mark, each in marked.items()}
    return [(element, names.get(f"{number}/")) for number, element in enumerate(elements)]


def keep_names(root: Any, description: Description, before: Given, *, spliced: bool) -> Iterator[Loss]:
    """Write the names of elements without one where the reader would now call them something else.

    Args:
        root: The tree after a cut.
        description: The robot that was cut.
        before: Names before the cut.
        spliced: Whether limbs changed place. Where none did, only names that were counted can change.
    """
    if not spliced and not any(_COUNTED.search(name or "") for _, name in before):
        return
    name_of = {id(element): name for element, name in before if name is not None}
    while True:  # a name that is written can be one that the reader would have given to another element
        try:
            now = given_names(root, description)
        except ValueError:
            return  # MuJoCo refuses the variant, which is for those to say who compile it
        written: set[int] = set()
        for element, name in now:
            wanted = name_of.get(id(element))
            if wanted in (None, name) or any(id(above) in written for above in element.iterancestors()):
                continue
            element.set("name", wanted)
            written.add(id(element))
            yield Loss("name", wanted or "", "", f"{_what(element)} had no name; it got the one that the source's has")
        if not written:
            return


def parse_tree(tree: Any, description: Description) -> mujoco.MjSpec:
    """What MuJoCo makes of a tree, includes flattened, with the models that it attaches."""
    models = prepare_parse(tree, description)
    return mujoco.MjSpec.from_string(etree.tostring(tree.getroot(), encoding="unicode"), include=models)


def _named_kinds(spec: mujoco.MjSpec) -> Sequence[Any]:
    return [*spec.bodies[1:], *spec.joints, *spec.actuators, *spec.sensors]


def _what(element: Any) -> str:
    section = str(element.getparent().tag)
    return f"the {section if section in ('actuator', 'sensor') else 'body' if element.tag == 'body' else 'joint'}"
