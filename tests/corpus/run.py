"""Run the corpus and write the table of results; `make corpus`.

    python -m tests.corpus.run FOLDER... --output docs/results/corpus.md

Every file runs in a worker process; one that crashes or hangs is a failure of that file alone.
"""

from __future__ import annotations

import argparse
import json
import queue
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import nullcontext
from pathlib import Path
from typing import Any

from .report import is_wrong, report
from .survey import Plan

SUFFIXES = (".urdf", ".xml", ".xacro")
PARTS = ["convert", "step", "cut"]
SECONDS_A_FILE = 300
"""How long a file may take, s; at a low priority, or beside other work, it takes longer: `--seconds`."""


def files(folders: list[Path]) -> Iterator[Path]:
    """All URDF and xacro files, and the MJCF files among the XML ones, sorted."""
    for folder in folders:
        for path in sorted(folder.rglob("*")):
            if path.suffix in SUFFIXES and path.is_file():
                if path.suffix == ".xml" and not _is_mjcf(path.read_bytes()):
                    continue
                yield path


def _is_mjcf(source: bytes) -> bool:
    return b"<mujoco" in source and b"<mujocoinclude" not in source


def run(paths: list[Path], plan: Plan, seconds: float = SECONDS_A_FILE) -> Iterator[dict[str, Any]]:
    """Outcomes of all files, as they come; one on which the worker dies, or takes more `seconds`, is a failure."""
    left = [str(path) for path in paths]
    while left:
        current, reason = None, ""
        command = [sys.executable, "-m", "tests.corpus.survey", str(plan.collection), str(plan.cuts), *plan.parts]
        worker = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
        assert worker.stdin is not None
        lines: queue.Queue[str | None] = queue.Queue()
        threading.Thread(target=_read, args=(worker.stdout, lines), daemon=True).start()
        threading.Thread(target=_write, args=(worker.stdin, "\n".join(left)), daemon=True).start()
        while True:
            try:
                line = lines.get(timeout=seconds)
            except queue.Empty:
                worker.kill()
                reason = f"no answer in {seconds:g} s"
                break
            if line is None:
                reason = f"the process ended with code {worker.wait()}"
                break
            if line.startswith("START "):
                current = line[6:]
                print(f"\r{len(paths) - len(left)}/{len(paths)}", end="", file=sys.stderr)
            elif line.startswith("END "):
                left.remove(line[4:])
                current = None
            elif line.startswith("{"):
                yield json.loads(line)
        if current is not None:
            left.remove(current)
            yield {"file": current, "result": "failure", "detail": reason}
    print(file=sys.stderr)


def _read(stream: Any, lines: queue.Queue[str | None]) -> None:
    for line in stream:
        lines.put(line.decode().rstrip("\n"))
    lines.put(None)


def _write(stream: Any, text: str) -> None:
    try:
        stream.write(text.encode())
        stream.close()
    except BrokenPipeError:
        pass


def main() -> int:
    """Parse the arguments, run, write; 1 where something is wrong."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folders", nargs="+", type=Path, help="folders that hold one collection each")
    parser.add_argument("--output", type=Path, help="write the table here instead of stdout")
    parser.add_argument("--raw", type=Path, help="write all outcomes here, one JSON object a line")
    parser.add_argument("--resume", action="store_true", help="go on after what --raw holds")
    parser.add_argument("--parts", nargs="*", default=PARTS, choices=PARTS, help="what is tried besides tokens")
    parser.add_argument("--cuts", type=int, default=sys.maxsize, help="how many limbs to cut of a robot, evenly spread")
    parser.add_argument("--seconds", type=float, default=SECONDS_A_FILE, help="how long a file may take")
    arguments = parser.parse_args()
    kept = arguments.raw.read_text() if arguments.resume and arguments.raw.is_file() else ""
    outcomes = [json.loads(line) for line in kept.splitlines()]
    done = {(outcome["collection"], outcome["file"]) for outcome in outcomes}
    with arguments.raw.open("a" if kept else "w") if arguments.raw is not None else nullcontext() as raw:
        for folder in arguments.folders:
            print(folder, file=sys.stderr)
            left = [path for path in files([folder]) if (folder.name, _short(str(path), folder)) not in done]
            for found in run(left, Plan(folder, arguments.parts, arguments.cuts), arguments.seconds):
                outcomes.append({**found, "collection": folder.name, "file": _short(found["file"], folder)})
                if raw is not None:
                    print(json.dumps(outcomes[-1]), file=raw, flush=True)
    text = report(outcomes)
    if arguments.output is not None:
        arguments.output.write_text(text)
    else:
        print(text)
    return 1 if any(map(is_wrong, outcomes)) else 0


def _short(file: str, folder: Path) -> str:
    return str(Path(file).relative_to(folder))


if __name__ == "__main__":
    sys.exit(main())
