"""Scale the limbs of an MJCF."""

from __future__ import annotations

import copy
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from lxml import etree

from morphkit.ablation.limb_scale import LimbScale
from morphkit.ablation.loss import Loss
from morphkit.ablation.mjcf import set_height
from morphkit.ablation.mjcf_document import MjcfFile, MjcfOpener
from morphkit.ablation.mjcf_names import parse_tree
from morphkit.description import Description
from morphkit.errors import AblationError
from morphkit.formats.poses import text
from morphkit.scaling.attributes import multiply, read
from morphkit.scaling.measures import Lift, Measures, measure
from morphkit.scaling.mjcf_actuators import scale_actuators
from morphkit.scaling.mjcf_limbs import Limbs
from morphkit.scaling.mjcf_meshes import scale_meshes
from morphkit.scaling.mjcf_tendons import has_spatial, scale_equalities, scale_tendons, tendon_factors


def scale_mjcf(description: Description, scales: Mapping[str, LimbScale], root: str) -> tuple[Description, list[Loss]]:
    """An MJCF with other limbs, and what could not be scaled.

    A root that can rise stands as much higher or lower as the robot has grown, measured from its lowest point.

    Args:
        description: The robot.
        scales: Factors by body, fixed bodies included.
        root: Name of the robot's root.

    Raises:
        AblationError: Something cannot be scaled.
        DescriptionError: MuJoCo has to compile the robot, and cannot.
        AssetError: The same for want of a mesh.
    """
    file = MjcfOpener(description).open([root])
    tree = file.source.root
    _refuse_flexes(tree, scales)
    keys = list(tree.iterfind("keyframe/key"))
    poses = [read(key, "qpos", key.get("qpos", "")) for key in keys]
    before = measure(_edited(file), root, poses) if _to_measure(tree, file.bodies[root], scales) else None

    parsed = parse_tree(etree.ElementTree(copy.deepcopy(tree)), file.description)
    limbs = Limbs(tree, file.bodies, scales, root, parsed)
    limbs.scale()
    scale_meshes(limbs)
    if before is None:
        tendons = tendon_factors(limbs)
        scale_actuators(limbs, tendons)
    else:
        poses = [_slid(pose, before, scales, root) for pose in poses]
        after = measure(_edited(file), root, poses)
        tendons = tendon_factors(limbs, before.tendons, after.tendons)
        _keep_total(tree, after.mass / before.mass)
        _lift_root(file, root, keys, poses, before, after)
        controls = scale_actuators(limbs, tendons)
        for key in keys if before.nu == len(controls) else ():
            multiply(key, "ctrl", controls)
    scale_tendons(limbs, tendons)
    scale_equalities(limbs, tendons)
    return _edited(file), [*file.findings, *_unscaled(tree, scales)]


def _edited(file: MjcfFile) -> Description:
    return replace(file.description, source=file.source.render(), document=None)


def _to_measure(tree: Any, root: Any, scales: Mapping[str, LimbScale]) -> bool:
    """Whether anything depends on what only a compiled model tells."""
    longer = any(scale.length != 1 for scale in scales.values())
    rises = next(root.iter("joint", "freejoint"), None) is not None
    total = any(compiler.get("settotalmass") for compiler in tree.iterfind("compiler"))
    heavier = any(scale.total_mass != 1 for scale in scales.values())
    keyed = tree.find("keyframe/key") is not None
    return (longer and (rises or has_spatial(tree))) or (heavier and total) or keyed


def _slid(pose: np.ndarray, before: Measures, scales: Mapping[str, LimbScale], root: str) -> np.ndarray:
    """A pose with the slides of longer limbs moved farther."""
    moved = pose.copy()
    for address, body in before.slides if len(pose) == before.nq else ():
        if body in scales and body != root:
            moved[address] *= scales[body].length
    return moved


def _keep_total(tree: Any, factor: float) -> None:
    """Let the mass of everything that the file states grow as the limbs do."""
    stating = [compiler for compiler in tree.iterfind("compiler") if compiler.get("settotalmass")]
    if stating and read(stating[-1], "settotalmass", stating[-1].get("settotalmass"))[0] > 0:
        multiply(stating[-1], "settotalmass", factor)


def _lift_root(
    file: MjcfFile, root: str, keys: Sequence[Any], poses: Sequence[np.ndarray], before: Measures, after: Measures
) -> None:
    """Put the root as far above its ground as the robot is higher now, in the zero pose and in every keyframe."""
    lift = before.lift
    heights = [_height(number, before, after) for number in range(len(before.root))]
    if lift is not None and heights[0] != before.root[0]:
        set_height(file.source.root, file.bodies[root], heights[0])
    for key, pose, height in zip(keys, poses, heights[1:], strict=True):
        if 0 < len(pose) == before.nq:
            moved = pose.copy()
            if lift is not None:
                moved[lift.address] = _coordinate(lift, height, heights[0])
            _write_changed(key, moved)


def _height(number: int, before: Measures, after: Measures) -> float:
    """Height of the root in a pose: what is below it, and what is between that and the ground, grow alike."""
    old, new = before.root[number] - before.lowest[number], after.root[number] - after.lowest[number]
    if old == new:
        return before.root[number]
    if min(old, new) <= 0:
        return before.root[number] + new - old
    return before.ground + (before.root[number] - before.ground) * new / old


def _coordinate(lift: Lift, height: float, zero: float) -> float:
    """The coordinate at which the root is at `height`, where it is at `zero` in the zero pose."""
    if lift.free:
        return height
    # `set_height` lets a slide that reads a height read the new one.
    reference = zero if lift.reference != 0 else 0.0
    return reference + lift.sign * (height - zero)


def _write_changed(key: Any, pose: np.ndarray) -> None:
    """Write the coordinates of a keyframe, those as written that are what they were."""
    words = key.get("qpos").split()
    if any(float(word) != value for word, value in zip(words, pose, strict=True)):
        pairs = zip(words, pose, strict=True)
        key.set("qpos", " ".join(word if float(word) == value else text(np.array([value])) for word, value in pairs))


def _refuse_flexes(tree: Any, scales: Mapping[str, LimbScale]) -> None:
    for flex in tree.iterfind("deformable/flex"):
        bodies = f"{flex.get('body', '')} {flex.get('node', '')}".split()
        if any(scales[body].length != 1 for body in bodies if body in scales):
            raise AblationError(
                f"line {flex.sourceline}: flex {flex.get('name')!r} cannot be scaled; leave the length of its limbs as"
                " it is"
            )


def _unscaled(tree: Any, scales: Mapping[str, LimbScale]) -> Iterator[Loss]:
    if any(scale.length != 1 for scale in scales.values()):
        for skin in tree.iter("skin"):
            yield Loss("skin", skin.get("name", ""), "", "keeps its size: a skin cannot be scaled")
