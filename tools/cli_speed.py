"""Wall time of `morphkit --help` and of `morphkit tokens` on URDFs of 100 and 2 000 links, and what these import.

Run with `make bench` or `python tools/cli_speed.py`. Exits with 1 where a limit is missed.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from pathlib import Path
from statistics import median

MORPHKIT = Path(sys.executable).with_name("morphkit")
RUNS = 7
HELP_LIMIT_S = 0.5
TOKENS_LIMIT_S = 1.5
LINKS = 100
LARGE_LIMIT_S = 5.0
LARGE_LINKS = 2000


def urdf(links: int) -> str:
    """A tree of `links` links with primitive shapes, three children a link, revolute joints throughout."""
    inertia = '<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/>'
    lines = ['<robot name="centipede">']
    for index in range(links):
        lines.append(
            f'<link name="link_{index}"><inertial><mass value="1"/>{inertia}</inertial>'
            '<collision><geometry><sphere radius="0.02"/></geometry></collision></link>'
        )
    for index in range(1, links):
        lines.append(
            f'<joint name="joint_{index}" type="revolute"><parent link="link_{(index - 1) // 3}"/>'
            f'<child link="link_{index}"/><origin xyz="0.1 0 -0.1"/><axis xyz="0 1 0"/>'
            '<limit lower="-1" upper="1" effort="10" velocity="5"/></joint>'
        )
    return "\n".join([*lines, "</robot>"])


def wall_time_s(*arguments: str) -> float:
    """Median wall time of `morphkit` with these arguments, s."""
    times = []
    for _ in range(RUNS):
        start = time.perf_counter()
        subprocess.run([MORPHKIT, *arguments], check=True, stdout=subprocess.DEVNULL)
        times.append(time.perf_counter() - start)
    return median(times)


def imported(*arguments: str) -> set[str]:
    """Top-level packages that `morphkit` with these arguments has imported when it ends."""
    code = (
        "import sys; from morphkit_cli.main import run; code = run(sys.argv[1:]); "
        "print(*sorted({name.partition('.')[0] for name in sys.modules}), file=sys.stderr); sys.exit(code)"
    )
    done = subprocess.run([sys.executable, "-c", code, *arguments], check=True, capture_output=True, text=True)
    return set(done.stderr.splitlines()[-1].split())


def main() -> int:
    with tempfile.TemporaryDirectory() as folder:
        robot = Path(folder) / "centipede.urdf"
        robot.write_text(urdf(LINKS), encoding="utf-8")
        help_s = wall_time_s("--help")
        tokens_s = wall_time_s("tokens", str(robot))
        large = Path(folder) / "millipede.urdf"
        large.write_text(urdf(LARGE_LINKS), encoding="utf-8")
        large_s = wall_time_s("tokens", str(large), "--format", "json")
        heavy = imported("tokens", str(robot)) & {"torch", "transformers"}
    print(f"morphkit --help:                     {help_s:.2f} s (limit {HELP_LIMIT_S} s), median of {RUNS}")
    print(f"morphkit tokens, URDF of {LINKS} links:  {tokens_s:.2f} s (limit {TOKENS_LIMIT_S} s), median of {RUNS}")
    print(f"morphkit tokens, URDF of {LARGE_LINKS} links: {large_s:.2f} s (limit {LARGE_LIMIT_S} s), median of {RUNS}")
    print(f"torch or transformers imported:      {', '.join(sorted(heavy)) or 'no'}")
    fast = help_s < HELP_LIMIT_S and tokens_s < TOKENS_LIMIT_S and large_s < LARGE_LIMIT_S
    return 0 if fast and not heavy else 1


if __name__ == "__main__":
    sys.exit(main())
