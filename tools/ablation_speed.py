"""Wall time and memory of `morphkit ablate --all` for 1 000 variants of a robot of 30 limbs, on two worker processes.

Every variant is cut, compiled by MuJoCo and written. Run with `make bench` or `python tools/ablation_speed.py`.
Exits with 1 where a limit is missed.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

MORPHKIT = Path(sys.executable).with_name("morphkit")
LIMBS = 30
VARIANTS = 1000
FEW = 250
JOBS = 2
TIME_LIMIT_S = 60.0
GROWTH_LIMIT = 1.15


def mjcf(limbs: int) -> str:
    """A many-legged robot of `limbs` limbs, with motors, sensors, sites, a tendon a leg and a keyframe."""
    bodies, actuators, sensors, tendons = [], [], [], []
    segments = ("hip", "thigh", "shin", "foot")
    legs, rest = divmod(limbs - 1, len(segments))
    for leg in range(legs + bool(rest)):
        parts = segments if leg < legs else segments[:rest]
        for depth, segment in enumerate(parts):
            name = f"leg{leg}_{segment}"
            place = f"{0.1 * leg:.1f} {0.2 * (-1) ** leg:.1f} 0" if depth == 0 else "0 0.05 -0.15"
            bodies.append(
                f'<body name="{name}" pos="{place}"> <!-- {segment} of leg {leg} -->\n'
                f'<joint name="{name}" axis="{"1 0 0" if depth % 2 else "0 1 0"}" range="-1 1"/>\n'
                f'<geom name="{name}" type="capsule" fromto="0 0 0 0 .05 -.15" size=".02"/><site name="{name}"/>'
            )
            actuators.append(f'<motor name="{name}" joint="{name}" gear="20" ctrlrange="-1 1"/>')
            sensors.append(f'<jointpos name="{name}" joint="{name}"/><touch name="{name}_touch" site="{name}"/>')
        bodies.append("</body>" * len(parts))
        points = "".join(f'<site site="leg{leg}_{segment}"/>' for segment in parts)
        tendons.append(f'<spatial name="leg{leg}"><site site="trunk"/>{points}</spatial>')
    pose = "0 0 1 1 0 0 0" + " 0.1" * (limbs - 1)
    return "\n".join([
        '<mujoco model="centipede"><compiler angle="radian" autolimits="true"/>',
        '<default><joint damping="1" armature=".01"/><geom density="500"/></default><worldbody>',
        '<body name="trunk" pos="0 0 1"><freejoint/><geom type="box" size=".4 .2 .05"/><site name="trunk"/>',
        *bodies, "</body></worldbody>",
        "<tendon>", *tendons, "</tendon>", "<actuator>", *actuators, "</actuator>", "<sensor>", *sensors, "</sensor>",
        f'<keyframe><key name="stand" qpos="{pose}"/></keyframe></mujoco>',
    ])  # fmt: skip


def family(robot: Path, variants: int) -> tuple[float, float]:
    """Wall time, s, and peak memory of the largest process, MB, of making this many variants."""
    command = [MORPHKIT, "ablate", robot, "--all", "--limit", variants, "--jobs", JOBS]
    start = time.perf_counter()
    process = subprocess.Popen([*map(str, command), "--output", str(robot.parent / f"out{variants}"), "--quiet"])
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode != 0:
        raise SystemExit(f"morphkit ablate failed with exit code {process.returncode}")
    return time.perf_counter() - start, usage.ru_maxrss * 1024 / 1e6


def main() -> int:
    with tempfile.TemporaryDirectory() as folder:
        robot = Path(folder) / "centipede.xml"
        robot.write_text(mjcf(LIMBS), encoding="utf-8")
        _, few_mb = family(robot, FEW)
        time_s, many_mb = family(robot, VARIANTS)
        written = len(list((robot.parent / f"out{VARIANTS}").glob("*.xml")))
    growth = many_mb / few_mb
    print(
        f"morphkit ablate, {written} variants of {LIMBS} limbs: {time_s:.1f} s (limit {TIME_LIMIT_S:.0f} s),"
        f" {1000 * time_s / written:.0f} ms each, {JOBS} processes"
    )
    print(
        f"peak memory:                                {many_mb:.0f} MB, {growth:.2f} times that of {FEW} variants"
        f" (limit {GROWTH_LIMIT})"
    )
    return 0 if written == VARIANTS and time_s < TIME_LIMIT_S and growth < GROWTH_LIMIT else 1


if __name__ == "__main__":
    sys.exit(main())
