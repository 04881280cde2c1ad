"""Random robots: kinematic trees as MJCF and URDF, with several joints a limb, fixed bodies, actuators and tendons."""

from __future__ import annotations

from dataclasses import dataclass

from hypothesis import strategies as st

from morphkit.description import Description, RobotInfo

WORDS = ("thigh", "shin", "foot", "arm", "left_leg", "FL_calf", "leg_1", "leg_1_2", "wrist_roll", "x")


@dataclass(frozen=True)
class Body:
    """A body of a random robot: `parent` is an index, -1 for the root; `joints` are kinds, none for a fixed body."""

    name: str
    parent: int
    joints: tuple[str, ...]
    pose: tuple[float, ...]
    anchor: float


@st.composite
def bodies(draw: st.DrawFn, kinds: tuple[str, ...], most_joints: int) -> tuple[Body, ...]:
    """A tree of 2 to 9 bodies in depth-first order, the root without joints."""
    count = draw(st.integers(2, 9))
    number = st.integers(-500, 500).map(lambda value: value / 1000)  # floats would mostly be 0
    words = draw(st.lists(st.sampled_from(WORDS), min_size=count, max_size=count))
    tree = [Body("root", -1, (), (0.0,) * 6, 0.0)]
    path = [0]  # the root and the bodies below it, down to the last one made
    for index in range(1, count):
        path = path[: draw(st.integers(1, len(path)))]
        joints = tuple(draw(st.lists(st.sampled_from(kinds), max_size=most_joints)))
        pose = tuple(draw(st.lists(number, min_size=6, max_size=6)))
        tree.append(Body(f"{words[index]}_{index}", path[-1], joints, pose, draw(number)))
        path.append(index)
    return tuple(tree)


@st.composite
def mjcf_robots(draw: st.DrawFn) -> Description:
    """A random robot as MJCF."""
    tree = draw(bodies(("hinge", "slide"), 3))
    free = draw(st.booleans())
    lines = ["<mujoco>", '  <compiler angle="radian"/>', "  <default><joint damping='1' armature='.1'/></default>"]
    lines += ["  <worldbody>", *_mjcf_body(tree, 0, free, "    "), "  </worldbody>"]
    joints = [f"{body.name}_j{number}" for body in tree for number in range(len(body.joints))]
    driven = [joint for joint in joints if draw(st.booleans())]
    tendons = (
        draw(st.lists(st.lists(st.sampled_from(joints), min_size=1, max_size=3, unique=True), max_size=2))
        if joints
        else []
    )
    lines.append("  <tendon>")
    for number, part in enumerate(tendons):
        fixed = "".join(f'<joint joint="{joint}" coef="1"/>' for joint in part)
        lines.append(f'    <fixed name="t{number}">{fixed}</fixed>')
    lines += ["  </tendon>", "  <actuator>"]
    for number, joint in enumerate(driven):
        kind = "motor" if number % 2 else "position"
        lines.append(f'    <{kind} name="{joint}_m" joint="{joint}" ctrlrange="-1 1"/> <!-- drives {joint} -->')
    lines += [f'    <motor name="t{number}_m" tendon="t{number}" ctrlrange="-1 1"/>' for number in range(len(tendons))]
    lines += ["  </actuator>", "  <sensor>"]
    lines += [f'    <jointpos name="{joint}_s" joint="{joint}"/>' for joint in joints]
    lines += [f'    <framepos name="{body.name}_s" objtype="body" objname="{body.name}"/>' for body in tree]
    lines += ["  </sensor>"]
    if draw(st.booleans()):
        qpos = [*([0, 0, 1, 1, 0, 0, 0] if free else []), *(round(0.01 * n, 2) for n in range(len(joints)))]
        ctrl = range(len(driven) + len(tendons))
        lines.append(f'  <keyframe><key name="k" qpos="{_text(qpos)}" ctrl="{_text(ctrl)}"/></keyframe>')
    lines.append("</mujoco>")
    return Description("robot", "robot.xml", "mjcf", "\n".join(lines).encode(), info=_info(draw))


@st.composite
def urdf_robots(draw: st.DrawFn) -> Description:
    """A random robot as URDF; a link without a moving joint is fixed to the one above it."""
    tree = draw(bodies(("revolute", "prismatic", "continuous"), 1))
    lines = ['<robot name="robot">']
    for body in tree:
        lines += [
            f'  <link name="{body.name}">',
            '    <inertial><mass value="1"/><inertia ixx=".1" iyy=".1" izz=".1" ixy="0" ixz="0" iyz="0"/></inertial>',
            '    <collision><geometry><sphere radius=".05"/></geometry></collision>',
            "  </link>",
        ]
    moving = []
    for body in tree[1:]:
        kind = body.joints[0] if body.joints else "fixed"
        joint = f"{body.name}_joint"
        moving += [joint] if body.joints else []
        mimic = f'<mimic joint="{moving[0]}"/>' if len(moving) > 1 and draw(st.integers(0, 3)) == 0 else ""
        lines += [
            f'  <joint name="{joint}" type="{kind}">',
            f'    <parent link="{tree[body.parent].name}"/><child link="{body.name}"/>',
            f'    <origin xyz="{_text(body.pose[:3])}" rpy="{_text(body.pose[3:])}"/><axis xyz="0 1 0"/>',
            f'    <limit lower="-1" upper="1" effort="3" velocity="2"/>{mimic}',
            "  </joint>",
        ]
    lines += [f'  <transmission name="{joint}_t"><joint name="{joint}"/></transmission>' for joint in moving]
    lines += [f'  <gazebo reference="{body.name}"/>' for body in tree if draw(st.booleans())]
    lines.append("</robot>")
    return Description("robot", "robot.urdf", "urdf", "\n".join(lines).encode(), info=_info(draw))


def _info(draw: st.DrawFn) -> RobotInfo:
    words = (("root",), ("thigh", "arm"), ("shin",), ("foot",))
    return RobotInfo(type_words=words if draw(st.booleans()) else ())


def _mjcf_body(tree: tuple[Body, ...], index: int, free: bool, indent: str) -> list[str]:
    body = tree[index]
    pose = f'pos="{_text(body.pose[:3])}" euler="{_text(body.pose[3:])}"'
    lines = [f'{indent}<body name="{body.name}" {pose}>', f'{indent}  <geom size=".05" contype="0"/>']
    lines += [f'{indent}  <freejoint name="free"/>'] if free and index == 0 else []
    for number, kind in enumerate(body.joints):
        axis = ("0 1 0", "1 0 0", "0 0 1")[number]
        attributes = f'type="{kind}" axis="{axis}" pos="0 0 {body.anchor}" range="-1 1"'
        lines.append(f'{indent}  <joint name="{body.name}_j{number}" {attributes}/>')
    for child, other in enumerate(tree):
        if other.parent == index:
            lines += _mjcf_body(tree, child, free, indent + "  ")
    return [*lines, f"{indent}</body>"]


def _text(values: object) -> str:
    return " ".join(str(value) for value in values)  # type: ignore[attr-defined]
