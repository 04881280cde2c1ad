"""Scale the limbs of a robot in its file: a URDF stays a URDF, an MJCF an MJCF."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import PurePath

from morphkit.ablation.ablate import Variant, file_name
from morphkit.ablation.limb_scale import SAME, LimbScale
from morphkit.ablation.loss import Loss
from morphkit.description import Description, RobotInfo
from morphkit.errors import AblationError
from morphkit.morphology import Joint, Morphology
from morphkit.readers import read
from morphkit.simulation.actuation import gains_of
from morphkit.utils.suggest import did_you_mean


def scale_limbs(variant: Variant | Description, scales: Mapping[str, LimbScale], *, name: str | None = None) -> Variant:
    """Make limbs longer, heavier or stronger.

    A limb with what is fixed to it grows by `length` in all directions, meshes included. Limbs still meet at their
    joints: of two limbs that a joint joins, its place on the one is scaled with the one and on the other with the
    other. A limb's mass goes with the cube of `length`, its moments of inertia with the fifth power, both times
    `mass`. Coordinates of slides grow with their limb; angles stay. What drives a limb gives `gain` times the force.
    A root that can rise stands as much higher or lower as the robot has grown.

    Args:
        variant: The robot; a variant that was cut out of another keeps what it says of that.
        scales: Factors by limb; others stay as they are.
        name: Name of the new robot; by default that of the old one and `-scaled`.

    Raises:
        AblationError: There is no such limb, or something cannot be scaled.
        DescriptionError: The robot cannot be read; for an MJCF also: MuJoCo has to compile it, and cannot.
        AssetError: MuJoCo has to compile it, and a mesh is missing.
    """
    if isinstance(variant, Description):
        limbs = tuple(limb.name for limb in read(variant).limbs)
        variant = Variant(variant, (), (), limbs, ())
    source = variant.description
    morphology = read(source)
    known = [limb.name for limb in morphology.limbs]
    for limb in scales:
        if limb not in known:
            raise AblationError(f"{source.file}: there is no limb {limb!r} to scale{did_you_mean(limb, known)}")
    of_member = {member: scales.get(limb.name, SAME) for limb in morphology.limbs for member in limb.members}
    name = name or f"{source.name}-scaled"
    try:
        scaled, lost = _scale(source, of_member, morphology.root.name)
    except AblationError as error:
        raise AblationError(f"{source.file}: {str(error).removeprefix(f'{source.file}: ')}") from None
    return replace(
        variant,
        description=replace(
            scaled,
            name=name,
            file=file_name(name, PurePath(source.file).suffix),
            info=scaled_info(source.info, morphology, scales),
        ),
        lost=(*variant.lost, *lost),
        scaled={limb: scales[limb] for limb in known if limb in scales},
    )


def scaled_info(info: RobotInfo, morphology: Morphology, scales: Mapping[str, LimbScale]) -> RobotInfo:
    """What is known of a robot whose limbs were scaled: gains of servos and the coordinates that it starts at."""
    gains = scaled_gains(info, morphology, scales)
    others = {joint: values for joint, values in info.gains.items() if joint not in gains}
    return replace(
        info,
        gains={**gains, **others},  # the first that matches counts
        start=scaled_start(info, morphology, scales),
        expert_return=None if any(scale != SAME for scale in scales.values()) else info.expert_return,
    )


def scaled_gains(
    info: RobotInfo, morphology: Morphology, scales: Mapping[str, LimbScale]
) -> dict[str, tuple[float, float]]:
    """Stiffness and damping of the servos of limbs that are stronger, by joint."""
    found = {}
    for joint, scale in _scaled_joints(morphology, scales):
        gains = gains_of(joint.name, info.gains)
        if gains is not None and scale.gain != 1:
            found[joint.name] = gains.stiffness * scale.gain, gains.damping * scale.gain
    return found


def scaled_start(info: RobotInfo, morphology: Morphology, scales: Mapping[str, LimbScale]) -> str | dict[str, float]:
    """The start of a robot whose slides go farther."""
    if isinstance(info.start, str):
        return info.start
    slides = {joint.name: scale.length for joint, scale in _scaled_joints(morphology, scales) if joint.kind == "slide"}
    return {joint: value * slides.get(joint, 1.0) for joint, value in info.start.items()}


def _scaled_joints(morphology: Morphology, scales: Mapping[str, LimbScale]) -> list[tuple[Joint, LimbScale]]:
    return [(joint, scales[limb.name]) for limb in morphology.limbs if limb.name in scales for joint in limb.joints]


def _scale(source: Description, scales: Mapping[str, LimbScale], root: str) -> tuple[Description, list[Loss]]:
    if all(scale == SAME for scale in scales.values()):
        return source, []
    if source.format == "urdf":
        from morphkit.scaling.urdf import scale_urdf

        return scale_urdf(source, scales)
    from morphkit.scaling.mjcf import scale_mjcf

    return scale_mjcf(source, scales, root)
