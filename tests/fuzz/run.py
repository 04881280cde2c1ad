"""Break robot files and run folders for some minutes; `make fuzz`.

Workers try cases that hypothesis makes, of one part after the other. One that raises, dies or takes more than 20 s
leaves the case and the reason in `.fuzz/`; this program then goes on with the next seed, and ends with 1 where anything
was found.
"""

from __future__ import annotations

import argparse
import contextlib
import faulthandler
import json
import subprocess
import sys
import time
import traceback
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from hypothesis.strategies import SearchStrategy

SECONDS_A_FILE = 20
SECONDS_A_WORKER = 60
PARTS = {"robots": ".xml", "runs": ".json"}
"""What is broken, and the suffix of a case."""


def part(name: str) -> tuple[SearchStrategy[bytes], Callable[[bytes], str]]:
    """Makes the cases of a part, and tries one."""
    if name == "runs":
        from .run_folders import UNBROKEN, attempt_run, broken_runs

        attempt_run(UNBROKEN)  # so that what is loaded and made once is not counted
        return broken_runs(), attempt_run
    from .strategies import broken_files
    from .target import attempt

    return broken_files(), attempt


def work(name: str, seed: int, folder: Path, seconds: float) -> int:
    """Try cases of one seed for so long; 1 where one raised: it is left, as small as hypothesis could make it."""
    from hypothesis import HealthCheck, Phase, given, settings
    from hypothesis import seed as seeded

    cases, attempt = part(name)
    end = time.monotonic() + seconds
    ends: Counter[str] = Counter()

    @seeded(seed)
    @settings(
        max_examples=10**6,
        deadline=None,
        database=None,
        report_multiple_bugs=False,
        phases=(Phase.generate, Phase.shrink),
        suppress_health_check=list(HealthCheck),
    )
    @given(source=cases)
    def fuzz(source: bytes) -> None:
        if time.monotonic() > end:
            raise KeyboardInterrupt  # which hypothesis takes for no bug of the file
        (folder / "current").write_bytes(source)
        faulthandler.dump_traceback_later(SECONDS_A_FILE, exit=True)
        try:
            ends[attempt(source)] += 1
        except Exception:
            (folder / "failing").write_bytes(source)
            (folder / "reason").write_text(traceback.format_exc())
            raise
        faulthandler.cancel_dump_traceback_later()

    with contextlib.suppress(BaseException):  # what was found is in the folder, as small as the time allowed
        fuzz()
    if (folder / "reason").exists():
        return 1
    print(json.dumps(ends), flush=True)
    return 0


def main() -> int:
    """Run workers one after another until the time is up."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=5.0)
    parser.add_argument("--seed", type=int, default=int(time.time()))
    parser.add_argument("--folder", type=Path, default=Path(".fuzz"))
    parser.add_argument("--part", choices=PARTS, help="break only this; default: one after the other")
    parser.add_argument("--worker", action="store_true", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    arguments.folder.mkdir(parents=True, exist_ok=True)
    if arguments.worker:
        return work(arguments.part, arguments.seed, arguments.folder, 60 * arguments.minutes)
    end = time.monotonic() + 60 * arguments.minutes
    seed, found, ends = arguments.seed, 0, Counter[str]()
    while time.monotonic() < end:
        for name in ("reason", "failing"):
            (arguments.folder / name).unlink(missing_ok=True)
        minutes = min(SECONDS_A_WORKER, end - time.monotonic()) / 60
        name = arguments.part or list(PARTS)[seed % len(PARTS)]
        options = {"--part": name, "--seed": seed, "--folder": arguments.folder, "--minutes": minutes}
        command = [
            sys.executable,
            "-m",
            "tests.fuzz.run",
            "--worker",
            *(str(o) for pair in options.items() for o in pair),
        ]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.stdout.startswith("{"):
            ends.update(json.loads(done.stdout))
        if done.returncode:
            found += 1
            reason = arguments.folder / "reason"
            text = reason.read_text() if reason.exists() else f"exit code {done.returncode}\n{done.stderr[-3000:]}"
            (arguments.folder / f"{seed}.txt").write_text(text)
            failing = arguments.folder / ("failing" if reason.exists() else "current")
            case = arguments.folder / f"{seed}{PARTS[name]}"
            case.write_bytes(failing.read_bytes())
            print(f"found: {case}: {text.strip().splitlines()[-1]}", flush=True)
        seed += 1
    print(f"{sum(ends.values())} cases tried ({', '.join(f'{n} {e}' for e, n in ends.most_common())}), {found} found")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
