"""Sun, sky and floor in the pictures: the same for every robot, whatever its file says."""

from __future__ import annotations

from typing import Any

import numpy as np

_SKY = (0.74, 0.82, 0.89, 1.0)
_TILES = ((0.87, 0.84, 0.78, 1.0), (0.79, 0.75, 0.68, 1.0))
_LEVEL = 0.999
_TILE_RADIUS = 12  # tiles each way
MAX_GEOMS = 4 * _TILE_RADIUS**2 + 1


def light(scene: Any, target: np.ndarray) -> None:
    """Replace all lights of an MjvScene but the headlight by one sun that throws shadows.

    Args:
        scene: The scene, after `mjv_updateScene`.
        target: What the camera looks at, world frame, m, shape (3,).
    """
    import mujoco

    scene.nlight = min(scene.nlight, 1)  # The first one is the headlight.
    sun = scene.lights[scene.nlight]
    scene.nlight += 1
    sun.type = mujoco.mjtLightType.mjLIGHT_DIRECTIONAL
    sun.headlight = 0
    sun.castshadow = 1
    sun.pos[:] = target + np.array([-1.5, -1.5, 4.0])
    sun.dir[:] = np.array([1.5, 1.5, -4.0]) / np.linalg.norm([1.5, 1.5, 4.0])
    sun.ambient[:] = 0.0
    sun.diffuse[:] = 0.55
    sun.specular[:] = 0.2


def add_sky(model: Any, scene: Any, target: np.ndarray, reach: float) -> None:
    """Put a bright ball around the scene where the model has no sky of its own."""
    import mujoco

    if mujoco.mjtTexture.mjTEXTURE_SKYBOX in model.tex_type:
        return
    ball = _add(scene, mujoco.mjtGeom.mjGEOM_SPHERE, np.full(3, 60 * reach), target, _SKY)
    ball.category = mujoco.mjtCatBit.mjCAT_DECOR  # Decoration throws no shadow.
    ball.emission = 0.55
    ball.specular = ball.shininess = ball.reflectance = 0.0


def open_floor(model: Any, data: Any) -> None:
    """Give level planes that things touch no end, as in the simulation; their pattern keeps its size.

    Args:
        model: The model, changed in place.
        data: The same after `mj_kinematics`.
    """
    import mujoco

    from morphkit.simulation.ground import can_touch

    planes = (model.geom_type == mujoco.mjtGeom.mjGEOM_PLANE) & can_touch(model) & (data.geom_xmat[:, 8] > _LEVEL)
    for plane in np.flatnonzero(planes & model.geom_size[:, :2].all(1)):
        material = model.geom_matid[plane]
        if material >= 0 and not model.mat_texuniform[material]:
            if (model.geom_matid == material).sum() > 1:
                continue
            model.mat_texrepeat[material] /= 2 * model.geom_size[plane, :2]
            model.mat_texuniform[material] = True
        model.geom_size[plane, :2] = 0.0


def tile_floor(scene: Any, target: np.ndarray, reach: float) -> None:
    """Lay flat tiles over a level plane without a material: on a bare floor nobody sees the robot move.

    Args:
        scene: The scene, after `mjv_updateScene`.
        target: What the camera looks at, world frame, m, shape (3,).
        reach: Size of the robot, m; tiles are about as long.
    """
    import mujoco

    planes = [geom for geom in scene.geoms[: scene.ngeom] if geom.type == mujoco.mjtGeom.mjGEOM_PLANE]
    floor = next((plane for plane in planes if plane.mat[2, 2] > _LEVEL and plane.matid < 0), None)
    if floor is None:
        return
    height = float(floor.pos[2])
    floor.rgba[:] = np.mean(_TILES, axis=0)
    floor.size[:2] = 0.0  # Without end.
    floor.pos[2] -= 0.02 * reach  # Else the two surfaces show through each other.
    side = 2.0 ** np.round(np.log2(reach))
    half = np.array([side / 2, side / 2, 0.001 * reach])
    first = np.floor(target[:2] / side).astype(int) - _TILE_RADIUS
    for x, y in np.ndindex(2 * _TILE_RADIUS, 2 * _TILE_RADIUS):
        column, row = first[0] + x, first[1] + y
        center = np.array([(column + 0.5) * side, (row + 0.5) * side, height - half[2]])
        tile = _add(scene, mujoco.mjtGeom.mjGEOM_BOX, half, center, _TILES[(column + row) % 2])
        tile.category = mujoco.mjtCatBit.mjCAT_STATIC


def _add(scene: Any, kind: Any, size: np.ndarray, position: np.ndarray, color: tuple[float, ...]) -> Any:
    import mujoco

    geom = scene.geoms[scene.ngeom]
    mujoco.mjv_initGeom(geom, kind, size, position, np.eye(3).ravel(), np.array(color, dtype=np.float32))
    scene.ngeom += 1
    return geom
