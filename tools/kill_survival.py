"""Kill morphkit's programs at random moments, over and over, and count what was lost.

    python tools/kill_survival.py --kills 200 --seed 0

Each round starts a program, sends SIGKILL to its process group after a random processor time (Linux), and starts it
again at once, up to four times; then once more, now to its end. What it wrote is compared with that of a run that
nobody disturbed. `train` and `benchmark run` go on from where they were; their weights have to be the same bit by bit.
A round counts as lost where the end differs, as half-written where temporary files are left.

Programs are forked from this process, which has imported what they need: kills come while they work.
"""

from __future__ import annotations

import argparse
import contextlib
import hashlib
import importlib
import json
import os
import random
import signal
import sys
import tempfile
import time
import zipfile
from collections import Counter
from pathlib import Path

os.environ["OMP_NUM_THREADS"] = "1"  # before PyTorch is imported

from morphkit_cli.main import run

IMPORTED = (
    *("conversion.write", "families.build", "families.write"),
    *("rl.benchmark.planning", "rl.benchmark.runner", "rl.export.write", "rl.training.trainer", "rl.text.encoder"),
)
"""Modules that the programs need; `rl.` stands for `morphkit_rl.`, others are of `morphkit`."""
SMALL_RUN = (
    *("--steps", "600", "--quiet", "--set", "trainer.checkpoint_seconds=0.2"),
    *("--set", "trainer.start_steps=200", "--set", "td3.batch_size=32"),
)
SMALL_BENCHMARK = """
tasks.few = ["few"]
splits.few.few = {train = ["hopper_3"], test = ["hopper_4"]}
"""
MOST_KILLS = 4
"""Of one output, before its program may end."""
CLOCK = ("evaluated", "elapsed_s")
"""Keys of a result that say when it was made and how long that took."""


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
        """The words after `morphkit` of a process that writes into `folder`."""
        return [word.replace("{}", str(folder)) for word in (self.again if again else self.arguments)]

    def begun(self, folder: Path) -> bool:
        """Whether there is something to go on with; a run that has no settings yet is started anew."""
        return (folder / "run" / "config.json").is_file() if self.name == "train" else any(folder.iterdir())

    def digest(self, folder: Path) -> dict[str, str]:
        """SHA-256 of what is compared, by path; that a checkpoint was written again makes no difference."""
        files = sorted(path for pattern in self.compared for path in folder.glob(pattern) if path.is_file())
        names = [str(path.relative_to(folder)).replace("-again", "") for path in files]
        return {name: hashlib.sha256(content(path)).hexdigest() for name, path in zip(names, files, strict=True)}


def content(path: Path) -> bytes:
    """The bytes of a file; of a cell's result without what the clock said, of TorchScript without the call stack."""
    if path.suffix == ".pt":
        with zipfile.ZipFile(path) as archive:
            names = [name for name in archive.namelist() if not name.endswith((".debug_pkl", "serialization_id"))]
            return b"".join(name.encode() + archive.read(name) for name in names)
    if path.name != "result.json":
        return path.read_bytes()
    return json.dumps({key: value for key, value in json.loads(path.read_bytes()).items() if key not in CLOCK}).encode()


def subjects(definition: Path) -> list[Subject]:
    """What is killed; `definition` is the file of a small benchmark."""
    definition.write_text(SMALL_BENCHMARK)
    train = ("train", "hopper_3", "--run", "{}/run", "--preset", "amorpheus-quick", "--seed", "3", *SMALL_RUN)
    cells = ("--file", str(definition), "--task", "few", "--split", "few", "--method", "amorpheus-quick")
    matrix = ("benchmark", "run", *cells, "--seeds", "2", "--episodes", "1", "--out", "{}/matrix", *SMALL_RUN)
    export = ("export", "zoo:hoppers", "hopper_3", "--torchscript", "{}/policy.pt")
    ablate = ("ablate", "hopper", "--all", "--output", "{}/family", "--quiet")
    convert = ("convert", "quadruped", "{}/robot.xml", "--json")
    resume = ("train", "--run", "{}/run", "--resume", "--quiet")
    return [
        Subject("ablate", ablate, (*ablate, "--force"), ("family/**/*",)),
        Subject("convert", convert, (*convert, "--force"), ("robot*", "robot_assets/**/*")),
        Subject("export", export, export, ("policy.pt",)),
        Subject("benchmark", matrix, matrix, ("matrix/**/checkpoints/*/*.safetensors", "matrix/**/result.json")),
        Subject("train", train, resume, ("run/checkpoints/*/*.safetensors",)),
    ]


def leftovers(folder: Path) -> list[str]:
    """Names of hidden files, which are temporary ones."""
    return [str(path.relative_to(folder)) for path in folder.rglob(".*") if path.name not in (".lock",)]


class Program:
    """A command in a process and a process group of its own, that prints into a file.

    Args:
        command: The words after `morphkit`.
        output: What it prints goes here.
    """

    def __init__(self, command: list[str], output: Path) -> None:
        self.code: int | None = None
        sys.stdout.flush()
        self.pid = os.fork()
        if self.pid == 0:
            code = 70
            try:
                os.setsid()
                descriptor = os.open(output, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o666)
                os.dup2(descriptor, 1)
                os.dup2(descriptor, 2)
                code = run(command)
            finally:
                sys.stdout.flush()
                os._exit(code)

    def ended(self) -> bool:
        """Whether it has."""
        if self.code is None:
            pid, status = os.waitpid(self.pid, os.WNOHANG)
            self.code = os.waitstatus_to_exitcode(status) if pid else None
        return self.code is not None

    def wait(self) -> int:
        """Its exit code."""
        while not self.ended():
            time.sleep(0.01)
        assert self.code is not None
        return self.code


def start(command: list[str], folder: Path) -> Program:
    """Start a command that writes into `folder`."""
    return Program(command, folder.parent / "output.txt")


def used_s(group: int) -> float:
    """Processor time of a process group, s."""
    ticks = 0
    for file in Path("/proc").glob("[0-9]*/stat"):
        with contextlib.suppress(OSError):
            fields = file.read_text().rpartition(")")[2].split()
            ticks += sum(map(int, fields[11:15])) if int(fields[2]) == group else 0
    return ticks / os.sysconf("SC_CLK_TCK")


def killed(process: Program, after_s: float) -> bool:
    """Kill a process group after so much processor time; False where it had ended by then."""
    while not process.ended():
        if used_s(process.pid) >= after_s:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()
            return True
        time.sleep(0.01)
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
        last = start(subject.command(folder, again=subject.begun(folder)), folder)
        code = last.wait()
        said = (Path(top) / "output.txt").read_text(errors="replace").strip().splitlines()
        if code:
            return kills, f"lost: exit code {code}: {said[-1] if said else ''}"
        found = subject.digest(folder)
        if others := sorted(name for name in {**whole, **found} if whole.get(name) != found.get(name)):
            return kills, f"lost: other content: {', '.join(others)}"
        if left := leftovers(folder):
            return kills, f"half-written: {left[0]}"
    return kills, "same"


def undisturbed(subject: Subject) -> tuple[dict[str, str], float]:
    """What a program writes, and the processor time that it takes, s."""
    with tempfile.TemporaryDirectory() as top:
        folder = Path(top) / "out"
        folder.mkdir()
        process, duration_s = start(subject.command(folder), folder), 0.0
        while not process.ended():
            duration_s = max(duration_s, used_s(process.pid))
            time.sleep(0.01)
        if process.code:
            sys.exit(f"{subject.name}: {(Path(top) / 'output.txt').read_text(errors='replace')}")
        return subject.digest(folder), duration_s


def main() -> int:
    """Kill until there were as many kills as wanted; 1 where anything was lost."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kills", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--minutes", type=float, default=60.0, help="stop after this time, whatever was reached")
    parser.add_argument("--only", action="append", help="name of a program; default: all in turn")
    arguments = parser.parse_args()
    for name in IMPORTED:
        importlib.import_module(f"morphkit_{name}" if name.startswith("rl.") else f"morphkit.{name}")
    with tempfile.TemporaryDirectory() as top:
        return fight(arguments, subjects(Path(top) / "benchmark.toml"))


def fight(arguments: argparse.Namespace, every: list[Subject]) -> int:
    """Kill, and print what became of it."""
    chance, end = random.Random(arguments.seed), time.monotonic() + 60 * arguments.minutes
    chosen = [subject for subject in every if not arguments.only or subject.name in arguments.only]
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
