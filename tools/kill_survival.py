"""Kill morphkit's programs at random moments, over and over, and count what was lost.

    python tools/kill_survival.py --kills 200 --seed 0

Each round starts a program, sends SIGKILL to its process group after a random time, starts the same command once more,
now to its end, and compares what it wrote with that of a run that nobody disturbed. `train` is killed, resumed and
killed again until it ends; its weights have to be the same bit by bit. A round counts as lost where the end differs,
as half-written where temporary files are left.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

PROGRAM = (sys.executable, "-m", "morphkit_cli.main")
SMALL_RUN = (
    *("--preset", "amorpheus-quick", "--steps", "600", "--seed", "3", "--quiet"),
    *("--set", "trainer.checkpoint_seconds=0.2"),
)
MOST_KILLS = 4
"""Of one training run."""


class Subject:
    """A command whose output is compared.

    Args:
        name: What is counted.
        arguments: Its words; `{}` stands for where it writes.
        again: The words after a kill.
        compared: Patterns of the files that have to be the same.
    """

    def __init__(
        self, name: str, arguments: tuple[str, ...], again: tuple[str, ...], compared: tuple[str, ...]
    ) -> None:
        self.name, self.arguments, self.again, self.compared = name, arguments, again, compared

    def command(self, folder: Path, *, again: bool = False) -> list[str]:
        """The words of a process that writes into `folder`."""
        return [*PROGRAM, *(word.replace("{}", str(folder)) for word in (self.again if again else self.arguments))]

    def begun(self, folder: Path) -> bool:
        """Whether there is something to go on with; a run that has no settings yet is started anew."""
        return (folder / "run" / "config.json").is_file() if self.name == "train" else any(folder.iterdir())

    def digest(self, folder: Path) -> dict[str, str]:
        """SHA-256 of what is compared, by path."""
        files = sorted(path for pattern in self.compared for path in folder.glob(pattern) if path.is_file())
        return {str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


def subjects() -> list[Subject]:
    """What is killed."""
    train = ("train", "hopper_3", "--run", "{}/run", *SMALL_RUN)
    ablate = ("ablate", "hopper", "--all", "--output", "{}/family", "--quiet")
    convert = ("convert", "quadruped", "{}/robot.xml", "--json")
    return [
        Subject("ablate", ablate, (*ablate, "--force"), ("family/**/*",)),
        Subject("convert", convert, (*convert, "--force"), ("robot*", "robot_assets/**/*")),
        Subject(
            "train", train, ("train", "--run", "{}/run", "--resume", "--quiet"), ("run/checkpoints/*/*.safetensors",)
        ),
    ]


def leftovers(folder: Path) -> list[str]:
    """Names of hidden files, which are temporary ones."""
    return [str(path.relative_to(folder)) for path in folder.rglob(".*") if path.name not in (".lock",)]


def start(command: list[str], folder: Path) -> subprocess.Popen[bytes]:
    """Start a process group that prints into a file."""
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    with (folder.parent / "output.txt").open("wb") as output:
        return subprocess.Popen(command, stdout=output, stderr=output, env=environment, start_new_session=True)


def killed(process: subprocess.Popen[bytes], after_s: float) -> bool:
    """Kill a process group after a time; False where it had ended by then."""
    try:
        process.wait(after_s)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()
        return True
    return False


def attack(subject: Subject, whole: dict[str, str], duration_s: float, chance: random.Random) -> tuple[int, str]:
    """How often a program was killed, and what became of its output: `same` where all is well."""
    kills = 0
    with tempfile.TemporaryDirectory() as top:
        folder = Path(top) / "out"
        folder.mkdir()
        for number in range(MOST_KILLS):
            again = number > 0 and subject.begun(folder)
            process = start(subject.command(folder, again=again), folder)
            if not killed(process, chance.uniform(0.05, 1.0) * duration_s):
                break
            kills += 1
            if subject.name != "train":
                break
        last = start(subject.command(folder, again=subject.begun(folder)), folder)
        code = last.wait()
        said = (Path(top) / "output.txt").read_text(errors="replace").strip().splitlines()
        if code:
            return kills, f"lost: exit code {code}: {said[-1] if said else ''}"
        if subject.digest(folder) != whole:
            return kills, "lost: other content"
        if left := leftovers(folder):
            return kills, f"half-written: {left[0]}"
    return kills, "same"


def undisturbed(subject: Subject) -> tuple[dict[str, str], float]:
    """What a program writes, and how long it takes, s."""
    with tempfile.TemporaryDirectory() as top:
        folder = Path(top) / "out"
        folder.mkdir()
        begin = time.monotonic()
        code = start(subject.command(folder), folder).wait()
        if code:
            sys.exit(f"{subject.name}: {(Path(top) / 'output.txt').read_text(errors='replace')}")
        return subject.digest(folder), time.monotonic() - begin


def main() -> int:
    """Kill until there were as many kills as wanted; 1 where anything was lost."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kills", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--minutes", type=float, default=60.0, help="stop after this time, whatever was reached")
    parser.add_argument("--only", action="append", help="name of a program; default: all in turn")
    arguments = parser.parse_args()
    chance, end = random.Random(arguments.seed), time.monotonic() + 60 * arguments.minutes
    chosen = [subject for subject in subjects() if not arguments.only or subject.name in arguments.only]
    wholes = {subject.name: undisturbed(subject) for subject in chosen}
    kills: Counter[str] = Counter()
    ends: Counter[str] = Counter()
    while sum(kills.values()) < arguments.kills and time.monotonic() < end:
        subject = chosen[sum(ends.values()) % len(chosen)]
        whole, duration_s = wholes[subject.name]
        count, found = attack(subject, whole, duration_s, chance)
        kills[subject.name] += count
        ends[f"{subject.name}: {found}"] += 1
        print(json.dumps({"program": subject.name, "kills": count, "end": found}), flush=True)
    print(json.dumps({"seed": arguments.seed, "kills": dict(kills), "ends": dict(ends)}, indent=2))
    return 0 if all(each.endswith(": same") for each in ends) else 1


if __name__ == "__main__":
    sys.exit(main())
