"""A robot in viser's scene: one frame a body, its shapes below it, moved by the simulator's kinematics."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np

from morphkit.simulation.inspection_model import Mechanics
from morphkit.simulation.visual_geoms import geom_color, visible_geoms
from morphkit.viewer.camera import viewpoint
from morphkit.viewer.geom_meshes import surface
from morphkit.viewer.web_origins import unprinted

_FLOOR_CELLS = 60
_SKY_TOP, _SKY_BOTTOM = (150, 176, 204), (226, 230, 234)
_WHITEST = 0.92  # A whiter white shows no shape.


class RobotScene:
    """Shows one robot at a time; what two robots have in common stays when one replaces the other.

    Args:
        server: The ViserServer.
        clicked: Called with the name of a body that is clicked on.
    """

    def __init__(self, server: Any, clicked: Callable[[str], None]) -> None:
        self._server = server
        self._clicked = clicked
        self._frames: dict[str, Any] = {}
        self._looks: dict[str, bytes] = {}
        self._mechanics: Mechanics | None = None

    def show(self, mechanics: Mechanics) -> None:
        """Replace the robot on show."""
        model = mechanics.model
        geoms: dict[int, list[int]] = {}
        for geom in visible_geoms(model):
            geoms.setdefault(int(model.geom_bodyid[geom]), []).append(geom)
        looks = {model.body(body).name: _look(model, own) for body, own in geoms.items()}
        for name in [name for name in self._frames if looks.get(name) != self._looks[name]]:
            self._frames.pop(name).remove()
        for body, own in geoms.items():
            name = model.body(body).name
            if name not in self._frames:
                self._frames[name] = self._add(mechanics, body, own)
        self._looks, self._mechanics = looks, mechanics

    def move(self, state: np.ndarray) -> None:
        """Put the robot into a pose, shape (nq,)."""
        assert self._mechanics is not None, "show a robot first"
        model = self._mechanics.model
        data = mujoco.MjData(model)
        data.qpos[:] = state
        mujoco.mj_kinematics(model, data)
        with self._server.atomic():
            for name, frame in self._frames.items():
                frame.position, frame.wxyz = data.body(name).xpos, data.body(name).xquat

    def set_up(self, mechanics: Mechanics, state: np.ndarray) -> None:
        """Floor, light and camera for a robot in its start pose."""
        model, scene = mechanics.model, self._server.scene
        scene.set_up_direction("+z")
        scene.configure_environment_map(None)  # Without a graphics card its light takes seconds a frame.
        scene.add_light_hemisphere("/sky", sky_color=(255, 255, 255), ground_color=(205, 195, 180), intensity=3.0)
        scene.set_background_image(_sky(), format="png")
        position, target = viewpoint(model, state, root=mechanics.root, base=mechanics.morphology.base, aspect=1.2)
        camera = self._server.initial_camera
        camera.position, camera.look_at, camera.up = tuple(position), tuple(target), (0.0, 0.0, 1.0)
        reach = float(np.linalg.norm(position - target))
        camera.near, camera.far = 0.01 * reach, 100 * reach
        cell = float(2.0 ** np.round(np.log2(reach / 8)))
        side = _FLOOR_CELLS * cell
        scene.add_grid(
            "/floor",
            width=side,
            height=side,
            cell_size=cell,
            section_size=4 * cell,
            cell_color=(186, 177, 163),
            section_color=(158, 148, 133),
            plane_color=(206, 197, 183),
            plane_opacity=1.0,
            shadow_opacity=0.35,
            fade_distance=4 * reach,
            position=(0.0, 0.0, _floor_height(model) - 1e-3 * reach),
        )

    def _add(self, mechanics: Mechanics, body: int, geoms: list[int]) -> Any:
        model = mechanics.model
        name = model.body(body).name
        scene = self._server.scene
        path = f"/bodies/{body_path(name)}"
        frame = scene.add_frame(path, show_axes=False)
        for geom in geoms:
            mesh = surface(model, geom)
            if mesh is None:
                continue
            color = geom_color(model, geom)
            handle = scene.add_mesh_simple(
                f"{path}/{geom}",
                mesh.vertices,
                mesh.faces,
                color=tuple(round(255 * min(_WHITEST, float(value))) for value in color[:3]),
                opacity=float(color[3]) if color[3] < 1 else None,
                side="double",
                position=model.geom_pos[geom],
                wxyz=model.geom_quat[geom],
            )
            if body in mechanics.limb_of:
                handle.on_click(unprinted(self._click_on(name)))
        return frame

    def _click_on(self, name: str) -> Callable[[Any], None]:
        return lambda _: self._clicked(name)


def _sky() -> np.ndarray:
    """Picture of a sky that gets lighter downwards, uint8: white robots are easy to see before it."""
    share = np.linspace(0, 1, 90)[:, None, None]
    colors = (1 - share) * np.array(_SKY_TOP) + share * np.array(_SKY_BOTTOM)
    return np.broadcast_to(colors, (90, 160, 3)).astype(np.uint8)


def body_path(name: str) -> str:
    """A body's name as one part of a path in viser's tree of nodes, different for different names."""
    return "".join(char if char.isalnum() or char in "_-" else f"%{ord(char):x}%" for char in name)


def _look(model: mujoco.MjModel, geoms: list[int]) -> bytes:
    """What tells whether a body looks the same in two models."""
    parts = []
    for geom in geoms:
        arrays = [model.geom_type, model.geom_size, model.geom_pos, model.geom_quat]
        parts += [np.ascontiguousarray(array[geom]).tobytes() for array in arrays]
        parts.append(geom_color(model, geom).tobytes())
        mesh = int(model.geom_dataid[geom])
        if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_MESH and mesh >= 0:
            first = model.mesh_vertadr[mesh]
            parts.append(model.mesh_vert[first : first + model.mesh_vertnum[mesh]].tobytes())
    return b"|".join(parts)


def _floor_height(model: mujoco.MjModel) -> float:
    planes = [geom for geom in range(model.ngeom) if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_PLANE]
    return float(model.geom_pos[planes[0], 2]) if planes else 0.0
