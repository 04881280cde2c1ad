"""Drives a robot with an exported policy; needs mujoco, numpy and onnxruntime alone.

$ morphkit export RUN cheetah --onnx policy.onnx
$ python examples/run_onnx.py policy.onnx robots/cheetah/cheetah.xml
"""

import json
import sys

import mujoco
import numpy as np
import onnxruntime

KEYS = ("sensor_limbs", "sensor_joints", "sensor_quantities", "sensor_components", "sensor_constants")


def sense(model, data, tokens):
    """One observation, float32 (1, tokens); joints are hinges with a range, as in robots/*/*.xml."""
    root_x, row = data.body(tokens[0][0]).xpos[0], []
    for limb, joint, quantity, component, constant in tokens:
        body, twist, turn = data.body(limb), np.zeros(6), np.zeros(3)
        mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_XBODY, body.id, twist, 0)
        mujoco.mju_quat2Vel(turn, body.xquat, 1)
        speed = np.clip(twist[3:], -10, 10)
        vectors = {"position": body.xpos - [root_x, 0, 0], "translational_velocity": speed,
                   "rotational_velocity": twist[:3], "exponential_map": turn}  # fmt: skip
        if quantity in vectors:
            row.append(vectors[quantity]["xyz".index(component)])
        elif constant is None:
            low, high = model.joint(joint).range
            row.append((data.joint(joint).qpos[0] - low) / (high - low))
        else:
            row.append(constant)
    return np.array([row], np.float32)


def load(policy):
    """The session, what the policy senses, and its control frequency, Hz."""
    try:
        session = onnxruntime.InferenceSession(policy)
        about = session.get_modelmeta().custom_metadata_map
        tokens = list(zip(*(json.loads(about[key]) for key in KEYS), strict=True))
        return session, tokens, float(about["control_frequency_hz"])
    except Exception as error:  # onnxruntime has no class of its own errors
        print(f"error: {policy}: no policy of 'morphkit export --onnx': {error}", file=sys.stderr)
        sys.exit(2)


def main(policy, robot, seconds=20.0):
    """Run for some seconds; how far the robot came, m."""
    session, tokens, frequency = load(policy)
    model = mujoco.MjModel.from_xml_path(robot)
    data = mujoco.MjData(model)
    for _ in range(round(seconds * frequency)):
        mujoco.mj_forward(model, data)
        data.ctrl[:] = session.run(["control"], {"observation": sense(model, data, tokens)})[0][0]
        mujoco.mj_step(model, data, round(1 / (frequency * model.opt.timestep)))
    return data.body(tokens[0][0]).xpos[0]


if __name__ == "__main__":
    print(f"{main(*sys.argv[1:3]):.1f} m")
