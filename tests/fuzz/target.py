"""What a broken file is put through: whatever happens, it has to be a result or a `MorphkitError`."""

from __future__ import annotations

import random
import zlib

import mujoco

from morphkit.ablation.ablate import ablate
from morphkit.description import Description
from morphkit.errors import MorphkitError
from morphkit.formats import xml
from morphkit.readers import read
from morphkit.simulation.build import compile_plain
from morphkit.tokens.spec import TokenSpec, token_spec


def attempt(source: bytes) -> str:
    """Read, tokenize, simulate and cut; return how far it got.

    What is cut depends on the bytes alone.
    """
    chance = random.Random(zlib.crc32(source))
    try:
        form = xml.root_format(xml.parse(source, file="broken"), file="broken")
        robot = Description("broken", "broken.urdf" if form == "urdf" else "broken.xml", form, source)
        morphology = read(robot)
        for naming in ("raw", "canonical"):
            spec = token_spec(morphology, naming=naming, source="all")
            assert TokenSpec.from_json(spec.to_json()) == spec
    except MorphkitError as error:
        return explained(error, "refused")
    _simulate(robot)
    members = [member for limb in morphology.limbs for member in limb.members][1:]
    if not members:
        return "read"
    chosen = chance.sample(members, k=min(len(members), chance.choice((1, 1, 2, 4))))
    try:
        variant = ablate(robot, **{chance.choice(("remove", "splice")): chosen})
        part = read(variant.description)
    except MorphkitError as error:
        return explained(error, "not cut")
    assert [limb.name for limb in part.limbs] == list(variant.limbs)
    return "cut, and the cut robot simulated" if _simulate(variant.description) else "cut"


def explained(error: MorphkitError, end: str) -> str:
    """`end`, for an error that says something."""
    assert str(error).strip()
    return end


def _simulate(robot: Description) -> bool:
    """Compile it and step once; whether MuJoCo accepts it."""
    try:
        model = compile_plain(robot)
    except MorphkitError as error:
        return not explained(error, "not compiled")
    mujoco.mj_step(model, mujoco.MjData(model))
    return True
