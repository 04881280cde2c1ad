"""What MuJoCo makes of an MJCF model; runs in the child of `probe`."""

from __future__ import annotations

import re
import warnings
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from morphkit.description import Description
from morphkit.errors import AssetError, DescriptionError
from morphkit.formats import xml
from morphkit.formats.limits import check_mjcf
from morphkit.readers.mjcf_actuators import is_limited
from morphkit.simulation.spec import compile_spec, load_spec
from morphkit.simulation.start_pose import outside_limits, stand, start_pose
from morphkit.validation.common import start_is_said
from morphkit.validation.overlaps import overlaps

_KINDS = {
    "body": "bodies", "joint": "joints", "geom": "geoms", "site": "sites", "camera": "cameras", "light": "lights",
    "tendon": "tendons", "actuator": "actuators", "sensor": "sensors", "material": "materials", "texture": "textures",
    "mesh": "meshes", "hfield": "hfields", "flex": "flexes",
}  # fmt: skip
_SIZES = {"qpos": "nq", "qvel": "nv", "act": "na", "ctrl": "nu"}


def examine(
    source: str, file: str, folder: str, packages: dict[str, str], start: str | dict[str, float]
) -> dict[str, Any]:
    """Parse and compile a model and look at its start.

    Args:
        source: The MJCF, includes flattened, an element a line.
        file: What it is called.
        folder: Where its assets start.
        packages: Folder of each package that may be read, by name.
        start: What `robot.toml` says of the start pose.

    Returns:
        `refused`: message and line where MuJoCo refuses it, else None; `names`: all names by kind; `sizes`: lengths of
        the vectors of a keyframe; `joints` and `actuators`: what the checks need of them, with their lines;
        `outside`: names of joints whose zero pose lies outside of their limits, where nothing says another start;
        `touching`: pairs of bodies that
        penetrate each other at the start, with the depth, m. What is not known is absent.
    """
    named = {name: Path(path) for name, path in packages.items()}
    description = Description(Path(file).stem, file, "mjcf", source.encode(), Path(folder), packages=named)
    found: dict[str, Any] = {"refused": None}
    try:
        check_mjcf(xml.parse(description.source, file=file).getroot(), file=file)
    except DescriptionError as error:
        return {"refused": _broken_limit(error)}
    try:
        warnings.simplefilter("ignore")
        plain = mujoco.MjSpec.from_string(source)
    except ValueError as error:
        if "<model" not in source and "<flexcomp" not in source:  # else files to read have to be located first
            return {"refused": _refusal(error)}
        plain = None
    try:
        spec, _ = load_spec(description, drawn=False)
    except (DescriptionError, ValueError) as error:
        return {"refused": _refusal(error)}
    except AssetError:
        spec = None  # files are checked for themselves
    if spec is not None or plain is not None:
        found |= _structure(spec if spec is not None else plain)
    if spec is None:
        return found
    keyframes = [(key.name, np.array(key.qpos)) for key in spec.keys]
    for key in list(spec.keys):
        spec.delete(key)  # their sizes are checked for themselves
    try:
        model = compile_spec(spec, file)
    except DescriptionError as error:
        return found | {"refused": _refusal(error)}
    found["sizes"] = {key: int(getattr(model, size)) for key, size in _SIZES.items()}
    found["sizes"] |= {"mpos": 3 * int(model.nmocap), "mquat": 4 * int(model.nmocap)}
    usable = [(name, qpos if qpos.size else model.qpos0) for name, qpos in keyframes if qpos.size in (0, model.nq)]
    said = start if start or not usable else "a keyframe"
    found["outside"] = [joint for joint in outside_limits(model) if not start_is_said(joint, said)]
    try:
        pose = start_pose(model, start, file, usable)
    except DescriptionError as error:
        return found | {"refused": _refusal(error)}
    for root in np.flatnonzero((model.body_parentid == 0) & (model.body_jntnum > 0)):
        pose = stand(model, pose, int(root))
    found["touching"] = overlaps(model, pose)
    return found


def _refusal(error: Exception) -> dict[str, Any]:
    message = " ".join(str(error).split())
    line = re.search(r"line (\d+)", message)
    # The line is one of the flattened text, so it is said by the place of the finding.
    message = re.sub(r",? ?(id \d+|line \d+)(, column \d+)?", "", message)
    message = re.sub(r"^.*?MuJoCo cannot (read|compile) it: ", "", message)
    return {"message": re.sub(r"(XML )?Error: ?", "", message).strip(), "line": int(line[1]) if line else None}


def _broken_limit(error: DescriptionError) -> dict[str, Any]:
    place = re.match(r"[^\n]*?:(\d+): (.*)", str(error), re.DOTALL)
    return {"message": place[2] if place else str(error), "line": int(place[1]) if place else None}


def _line(info: str) -> int | None:
    line = re.search(r"line (\d+)", info or "")
    return int(line[1]) if line else None


def _structure(spec: mujoco.MjSpec) -> dict[str, Any]:
    names = {kind: [each.name for each in getattr(spec, plural) if each.name] for kind, plural in _KINDS.items()}
    driven = {each.target for each in spec.actuators}
    coupled = {name for each in spec.equalities for name in (each.name1, each.name2)}
    coupled |= {joint for tendon in spec.tendons for joint in _tendon_joints(tendon)}
    kinds = mujoco.mjtJoint
    joints = [
        {
            "name": joint.name,
            "line": _line(joint.info),
            "angular": joint.type in (kinds.mjJNT_HINGE, kinds.mjJNT_BALL),
            "hinge": joint.type == kinds.mjJNT_HINGE,
            "low": float(joint.range[0]),
            "high": float(joint.range[1]),
            "degree": bool(joint.compiler.degree),
            "limited": is_limited(spec, joint.limited, float(joint.range[0]), float(joint.range[1])),
            "passive": joint.type != kinds.mjJNT_FREE
            and joint.parent.parent.name != "world"
            and not np.any(joint.stiffness)
            and joint.name not in driven | coupled,
        }
        for joint in spec.joints
    ]
    actuators = [
        {
            "name": each.name,
            "line": _line(each.info),
            "bounded": is_limited(spec, each.ctrllimited, float(each.ctrlrange[0]), float(each.ctrlrange[1]))
            or float(each.inheritrange) > 0
            or each.dyntype == mujoco.mjtDyn.mjDYN_MUSCLE,  # it clips its excitation to 0..1
        }
        for each in spec.actuators
    ]
    return {"names": names, "joints": joints, "actuators": actuators}


def _tendon_joints(tendon: Any) -> list[str]:
    return [wrap.target.name for wrap in tendon.path if wrap.type == mujoco.mjtWrap.mjWRAP_JOINT and wrap.target]
