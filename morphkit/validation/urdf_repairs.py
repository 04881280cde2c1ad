"""What every command that reads a URDF changes in it first."""

from __future__ import annotations

import copy

from morphkit.formats.urdf_names import WORLD
from morphkit.readers.urdf_normalize import drop_repeated, settle_parts
from morphkit.validation.document import CheckedDocument, elements


def check_repairs(doc: CheckedDocument) -> None:
    """Report what counts for nothing or is completed; what is there again goes, so that checks look at the first."""
    for repair in drop_repeated(doc.root):
        doc.add(repair.rule, repair.element, repair.text, name=repair.name)
    for repair in settle_parts(copy.deepcopy(doc.root)):
        if repair.rule not in ("number-infinite", "limit-inverted"):  # all numbers are looked at elsewhere
            doc.add(repair.rule, repair.element, repair.text, name=repair.name)
    for joint in elements(doc.root, "joint"):
        for child in elements(joint, "child"):
            if child.get("link") == WORLD:
                doc.add(
                    "world-inside", child, f"link {WORLD!r} is the child of joint {joint.get('name')!r}", name=WORLD
                )
