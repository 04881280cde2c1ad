"""Attack the project for some minutes; `make fuzz`.

Each part of the attack makes files (with hypothesis) and tries them. Files at which it raises, dies, takes more than
20 s or more than 2 GiB are left in `.fuzz/` with the reason; this program then goes on with the next seed, and ends
with 1 where anything was found.
"""

from __future__ import annotations

import argparse
import contextlib
import faulthandler
import importlib
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
import traceback
from collections import Counter
from pathlib import Path

PARTS = {"robots": 240, "budgets": 60, "shapes": 200, "run_folders": 30, "folders": 20, "names": 12, "xacro": 100}
"""Modules of this package with `examples()`, a strategy of files by name, and `attempt(files, folder)`.

And how many examples of each a slow machine tries in a minute for all of them.
"""
SECONDS_AN_EXAMPLE = 20
"""Processor time, that of processes which an example starts included."""
MOST_SECONDS = 600
"""Time until an example counts as hanging; others may want the same cores."""
SECONDS_A_WORKER = 150
MOST_MEMORY = 2 * 1024**3


def work(part: str, seed: int, folder: Path, seconds: float, examples: int = 10**6) -> int:
    """Try files of one seed for so long; 1 where one raised: it is left, as small as hypothesis could make it."""
    from hypothesis import HealthCheck, Phase, given, settings
    from hypothesis import seed as seeded

    attack = importlib.import_module(f"tests.fuzz.{part}")
    made = attack.examples()
    end = time.monotonic() + seconds
    ends: Counter[str] = Counter()

    @seeded(seed)
    @settings(
        max_examples=examples,
        deadline=None,
        database=None,
        report_multiple_bugs=False,
        phases=(Phase.generate, Phase.shrink),
        suppress_health_check=list(HealthCheck),
    )
    @given(files=made)
    def fuzz(files: dict[str, bytes]) -> None:
        if time.monotonic() > end:
            raise KeyboardInterrupt  # which hypothesis takes for no bug of the file
        _write(files, folder / "current")
        faulthandler.dump_traceback_later(MOST_SECONDS, exit=True)
        before = _processor_time()
        try:
            with tempfile.TemporaryDirectory() as place:
                ends[f"{part}: {attack.attempt(files, Path(place))}"] += 1
            used = _processor_time() - before
            assert used < SECONDS_AN_EXAMPLE, f"{used:.0f} s of processor time"
            _check_memory()
        except Exception:
            _write(files, folder / "failing")
            (folder / "reason").write_text(traceback.format_exc())
            raise
        faulthandler.cancel_dump_traceback_later()

    with contextlib.suppress(BaseException):  # what was found is in the folder, as small as the time allowed
        fuzz()
    if (folder / "reason").exists():
        return 1
    print(json.dumps(ends), flush=True)
    return 0


def _processor_time() -> float:
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system


def _check_memory() -> None:
    import resource

    for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN):
        most = resource.getrusage(who).ru_maxrss * 1024
        assert most < MOST_MEMORY, f"{most / 2**30:.1f} GiB"


def _write(files: dict[str, bytes], folder: Path) -> None:
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    for name, content in files.items():
        (folder / name).write_bytes(content)


def _start(part: str, seed: int, folder: Path, seconds: float, fixed: bool) -> subprocess.CompletedProcess[str]:
    (folder / "reason").unlink(missing_ok=True)
    options = {"--part": part, "--seed": seed, "--folder": folder, "--minutes": seconds / 60}
    words = [str(word) for option in options.items() for word in option]
    command = [sys.executable, "-m", "tests.fuzz.run", "--worker", *words, *(["--fixed"] if fixed else [])]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def main() -> int:
    """Run workers one after another until the time is up."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=5.0)
    parser.add_argument("--seed", type=int, default=int(time.time()))
    parser.add_argument("--part", choices=list(PARTS), action="append", help="one part of the attack instead of all")
    parser.add_argument("--folder", type=Path, default=Path(".fuzz"))
    parser.add_argument("--fixed", action="store_true", help="each part once, the same examples on every machine")
    parser.add_argument("--worker", action="store_true", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    folder, parts = arguments.folder, arguments.part or list(PARTS)
    folder.mkdir(parents=True, exist_ok=True)
    if arguments.worker:
        examples = {"examples": PARTS[parts[0]]} if arguments.fixed else {}
        return work(parts[0], arguments.seed, folder, 60 * arguments.minutes, **examples)
    end = time.monotonic() + (0 if arguments.fixed else 60 * arguments.minutes)
    longest = 3600.0 if arguments.fixed else min(SECONDS_A_WORKER, 60 * arguments.minutes / len(parts))
    seed, found, ends = arguments.seed, 0, Counter[str]()
    while time.monotonic() < end or seed - arguments.seed < len(parts):  # each part at least once
        part = parts[(seed - arguments.seed) % len(parts)]
        done = _start(part, seed, folder, longest, arguments.fixed)
        if done.stdout.startswith("{"):
            ends.update(json.loads(done.stdout))
        if done.returncode:
            found += 1
            reason = folder / "reason"
            text = reason.read_text() if reason.exists() else f"exit code {done.returncode}\n{done.stderr[-3000:]}"
            kept = folder / f"{part}-{seed}"
            shutil.rmtree(kept, ignore_errors=True)
            shutil.copytree(folder / ("failing" if reason.exists() else "current"), kept)
            (folder / f"{part}-{seed}.txt").write_text(text)
            print(f"found: {kept}: {text.strip().splitlines()[-1]}", flush=True)
        seed += 1
    print("\n".join(f"{number:8} {end}" for end, number in sorted(ends.items())))
    print(f"{sum(ends.values())} examples tried, {found} found")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
