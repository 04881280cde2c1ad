"""Pictures of a simulated robot, drawn off-screen by MuJoCo through OpenGL."""

from __future__ import annotations

import copy
from collections.abc import Collection, Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from morphkit.errors import ConfigError
from morphkit.viewer import scenery
from morphkit.viewer.camera import FIELD_OF_VIEW, MARGIN, VIEWS, move, view_of_all
from morphkit.viewer.offscreen import OffscreenRenderer

if TYPE_CHECKING:
    from morphkit.simulation.build import Simulation

_MARK = (0.95, 0.42, 0.16)
_HIDDEN_GROUP = 5
_HEIGHT_SMOOTHING = 0.05  # share of the way that the camera follows up and down in a frame


def resample(qpos: np.ndarray, fps: float, most: float = 30.0) -> tuple[np.ndarray, float]:
    """Leave out states so that a video of them has at most `most` frames per second and runs at the same speed.

    Args:
        qpos: States, shape (n, nq), `fps` of them a second.
        fps: States per second.
        most: Greatest number of frames per second.

    Returns:
        Every k-th state, and the frames per second that are left.
    """
    step = max(1, int(np.ceil(fps / most - 1e-9)))
    return qpos[::step], fps / step


def render(
    simulation: Simulation, qpos: np.ndarray | None = None, *, width: int = 640, height: int = 480
) -> np.ndarray:
    """Draw states of a robot; the camera follows its root.

    Args:
        simulation: The robot.
        qpos: States in the order of MuJoCo's qpos (m, rad, unit quaternions), shape (n, nq) or (nq,). None: the model's
            start pose. States that are not finite are left out.
        width: Width of a picture, pixels.
        height: Height of a picture, pixels.

    Returns:
        uint8 array, shape (n, height, width, 3), RGB.

    Raises:
        DependencyError: No OpenGL; the message says which system packages to install.
    """
    return np.stack(list(render_frames(simulation, qpos, width=width, height=height)))


def render_frames(
    simulation: Simulation,
    qpos: np.ndarray | None = None,
    *,
    width: int = 640,
    height: int = 480,
    reach: float | None = None,
) -> Iterator[np.ndarray]:
    """Like `render`, one picture of shape (height, width, 3) at a time: long videos need little memory.

    Args:
        simulation: The robot.
        qpos: States, shape (n, nq) or (nq,), or None.
        width: Width of a picture, pixels.
        height: Height of a picture, pixels.
        reach: Half of the picture's smaller side, m; default: what shows the whole robot. Pictures of several robots
            with the same reach have the same scale.
    """
    root = int(simulation.limb_body[0])
    yield from model_frames(
        _visuals_only(simulation.model) if simulation.description.format == "urdf" else simulation.model,
        simulation.start if qpos is None else qpos,
        root=root,
        base=simulation.base,
        width=width,
        height=height,
        reach=reach,
    )


def model_frames(
    model: Any,
    qpos: np.ndarray | None = None,
    *,
    root: int = 1,
    base: str = "free",
    width: int = 640,
    height: int = 480,
    reach: float | None = None,
    still: bool = False,
    marked: Sequence[Collection[int]] = (),
) -> Iterator[np.ndarray]:
    """Like `render_frames` for any MjModel.

    Args:
        model: The model.
        qpos: States, shape (n, nq) or (nq,), or None.
        root: Body id that the camera follows.
        base: How the root is attached; it chooses the camera's side.
        width: Width of a picture, pixels.
        height: Height of a picture, pixels.
        reach: Half of the picture's smaller side, m.
        still: The camera stays where it is at the first state, far enough away to show all of them.
        marked: For every state, ids of bodies that are drawn in a color that stands out.
    """
    import mujoco

    if width < 1 or height < 1:
        raise ConfigError(f"a picture of {width} x {height} pixels cannot be drawn: both must be at least 1")
    states = np.atleast_2d(model.qpos0 if qpos is None else np.asarray(qpos, dtype=np.float64))
    if states.ndim != 2 or states.shape[1] != model.nq:
        raise ConfigError(f"states have shape {states.shape}, expected (n, {model.nq})")
    finite = np.isfinite(states).all(axis=1)
    marks = (
        [bodies for bodies, keep in zip(marked, finite, strict=True) if keep] if marked else [()] * int(finite.sum())
    )
    states = states[finite]
    if not len(states):
        raise ConfigError("there is no state to draw: at least one must have finite numbers only")
    model = copy.copy(model)  # The simulation's own model stays as it is.
    data = mujoco.MjData(model)
    move(model, data, states[0])
    shown = _reach(model, data, root) if reach is None else reach
    _prepare(model, width, height, shown, fine=len(states) == 1)
    scenery.open_floor(model, data)
    scene = mujoco.MjvScene(model, maxgeom=10_000 + scenery.MAX_GEOMS)
    scene.flags[mujoco.mjtRndFlag.mjRND_REFLECTION] = False
    scene.flags[mujoco.mjtRndFlag.mjRND_CULL_FACE] = False  # The sky is a ball seen from inside.
    camera = mujoco.MjvCamera()
    camera.azimuth, camera.elevation = VIEWS.get(base, VIEWS["free"])
    camera.distance = MARGIN * shown / (np.tan(np.radians(FIELD_OF_VIEW / 2)) * min(1.0, width / height))
    camera.lookat[:] = target = _target(data, root, base)
    if still:
        target, camera.distance, shown = view_of_all(model, data, states, root, camera, width / height)
        camera.lookat[:] = target
    option = mujoco.MjvOption()
    context = OffscreenRenderer(model, width, height)
    try:
        for state, bodies in zip(states, marks, strict=True):
            move(model, data, state)
            if not still:
                target = _target(data, root, base)
                target[2] = camera.lookat[2] + _HEIGHT_SMOOTHING * (target[2] - camera.lookat[2])
                camera.lookat[:] = target
            mujoco.mjv_updateScene(model, data, option, None, camera, mujoco.mjtCatBit.mjCAT_ALL, scene)
            _mark(model, scene, bodies)
            scenery.light(scene, target)
            scenery.tile_floor(scene, target, shown)
            scenery.add_sky(model, scene, target, shown)
            yield context.draw(scene)
    finally:
        context.close()


def start_reach(simulation: Simulation) -> float:
    """Distance from the robot's center to its farthest point in the start pose, m."""
    import mujoco

    data = mujoco.MjData(simulation.model)
    move(simulation.model, data, simulation.start)
    return _reach(simulation.model, data, int(simulation.limb_body[0]))


def _reach(model: Any, data: Any, root: int) -> float:
    mine = model.body_rootid[model.geom_bodyid] == model.body_rootid[root]
    if not mine.any():
        return 1.0
    offsets = np.linalg.norm(data.geom_xpos[mine] - data.subtree_com[root], axis=1)
    return float(max(0.05, np.max(offsets + model.geom_rbound[mine])))


def _mark(model: Any, scene: Any, bodies: Collection[int]) -> None:
    """Paint the geoms of some bodies in a scene."""
    import mujoco

    for geom in scene.geoms[: scene.ngeom] if bodies else ():
        if geom.objtype == mujoco.mjtObj.mjOBJ_GEOM and int(model.geom_bodyid[geom.objid]) in bodies:
            geom.rgba[:3] = _MARK
            geom.matid = -1
            geom.emission = 0.25


def _visuals_only(model: Any) -> Any:
    """A copy of a URDF's model in which bodies with visual shapes do not show their collision shapes."""
    model = copy.copy(model)
    collides = (model.geom_contype | model.geom_conaffinity) != 0
    with_visuals = np.unique(model.geom_bodyid[~collides])
    model.geom_group[collides & np.isin(model.geom_bodyid, with_visuals) & (model.geom_bodyid != 0)] = _HIDDEN_GROUP
    return model


def _prepare(model: Any, width: int, height: int, reach: float, *, fine: bool) -> None:
    """Set what MuJoCo's renderer takes from the model: size of the picture, shadows, light at the camera.

    Fine edges and shadows cost a third of the time without a graphics card: films do without.
    """
    model.vis.global_.offwidth, model.vis.global_.offheight = width, height
    model.vis.global_.fovy = FIELD_OF_VIEW
    model.vis.quality.offsamples = 4 if fine else 2
    model.vis.quality.shadowsize = 2048 if fine else 1024
    model.vis.map.shadowclip = 1.0
    model.stat.extent = 5 * reach  # Width of the shadow map; a smaller one leaves stripes on the floor.
    model.vis.headlight.active = 1
    model.vis.headlight.ambient[:] = 0.42
    model.vis.headlight.diffuse[:] = 0.30
    model.vis.headlight.specular[:] = 0.05


def _target(data: Any, root: int, base: str) -> np.ndarray:
    """Where the camera looks, world frame, m."""
    target: np.ndarray = np.array(data.subtree_com[root])
    if base != "fixed":
        target[:2] = data.xpos[root][:2]
    return target
