"""Meshes that MuJoCo refuses: made acceptable, or left out where they only decorate."""

from __future__ import annotations

import re
from collections.abc import Iterator

import mujoco

from morphkit.errors import DescriptionError
from morphkit.simulation.spec import drop_shape

_ELEMENT = re.compile(r"Element name '(.*?)', id \d+", re.DOTALL)


def settle_meshes(spec: mujoco.MjSpec, file: str) -> Iterator[str]:
    """Make MuJoCo accept every mesh: flat ones as shells; what it still refuses goes, which is said.

    Args:
        spec: Changed in place.
        file: What the robot is called in messages.

    Raises:
        DescriptionError: It refuses a mesh that contacts need.
    """
    for _ in range(2 * len(spec.meshes)):
        try:
            with_joints = spec.copy()
            with_joints.compile()
            return
        except ValueError as error:
            named = _ELEMENT.search(str(error))
            mesh = spec.mesh(named[1]) if named is not None else None
            if mesh is None:
                return  # not about a mesh; the final compilation reports it
            shell = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL
            users = [geom for geom in spec.geoms if geom.meshname == mesh.name]
            if mesh.inertia != shell and "volume" in str(error):
                mesh.inertia = shell
                continue
            reason = " ".join(str(error).split("\n")[0].split())
            if any(geom.contype or geom.conaffinity for geom in users):
                raise DescriptionError(f"{file}: mesh {mesh.file!r} is needed for contacts: {reason}") from error
            yield f"visual mesh {mesh.file!r} was left out: MuJoCo: {reason}"
            drop_shape(spec, mesh, users)
