"""`morphkit evaluate`: what a trained policy is worth, compared with a random one."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import typer

from . import common
from .table import table, terminal_width
from .terminal import label, note, write

if TYPE_CHECKING:
    import numpy as np

    from morphkit.description import Description
    from morphkit.simulation.build import Simulation
    from morphkit_rl.evaluation.evaluate import RobotResult

VIDEO_SUFFIXES = (".mp4", ".gif")
VIDEO_WIDTH, VIDEO_HEIGHT = 480, 320
COLUMNS = ("body", "trained on", "return", "std", "random", "random 95 %", "normalized")

EXAMPLES = (
    "morphkit evaluate runs/first cheetah-family",
    "morphkit evaluate runs/first cheetah_3_balanced --episodes 20 --video out.mp4",
    "morphkit evaluate runs/first cheetah-family --checkpoint best",
)


def evaluate(
    run: common.PolicyArgument,
    robots: Annotated[
        list[str],
        typer.Argument(metavar="ROBOT", help="Shipped robots, URDF or MJCF files, folders of them, or manifests."),
    ],
    episodes: Annotated[int, typer.Option(min=1, metavar="N", help="Noise-free episodes per body.")] = 10,
    seed: Annotated[int, typer.Option(help="Seed of the start states and of the random policy.")] = 0,
    task: Annotated[
        str | None, typer.Option(metavar="NAME_OR_FILE", help="Task of all bodies.", show_default="as in the run")
    ] = None,
    base: common.RunBaseOption = None,
    video: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Film an episode: an .mp4 or .gif; of several bodies, FILE-<body> each."),
    ] = None,
    checkpoint: common.CheckpointOption = "latest",
    encoder: common.EncoderOption = None,
    xacro_arg: common.XacroArgOption = None,
    trust_xacro: common.TrustXacroOption = False,
    track: common.TrackOption = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON, with the return of every episode.")] = False,
) -> None:
    """Run a trained policy on bodies, trained on or never seen, compared with a random policy.

    Prints the mean return over noise-free episodes; the random policy's mean with its 95 %
    bootstrap interval; and the normalized score (return - random) / (expert - random) of bodies
    whose expert return is known.
    """
    if video is not None:
        _check_video(video)
    bodies = common.load_bodies(robots, xacro_arg, trust_xacro=trust_xacro)

    from morphkit_rl.evaluation.evaluate import evaluate as measure
    from morphkit_rl.runs import saved_policy, trackers, zoo
    from morphkit_rl.runs.run_folder import POLICY

    if track is not None:
        if (zoo.find(run) / POLICY).is_file():
            raise common.UsageError(f"--track adds to a run that training began; {run} is a policy without its run.")
        trackers.require(track)
    where: dict[str, Any] = {"task": task, "base": base, "encoder": encoder, "checkpoint": checkpoint}
    found = measure(run, bodies, episodes=episodes, seed=seed, **where)
    policy = saved_policy.load(run, checkpoint)
    name, steps, elapsed_s = policy.origin.parent.name, policy.state["steps"], policy.state["elapsed_s"]
    if as_json:
        rows = [_row(result) for result in found]
        trained = {"checkpoint": name, "steps": steps, "elapsed_s": round(elapsed_s, 3)}
        common.print_json({"run": str(run), **trained, "episodes": episodes, "seed": seed, "robots": rows})
    else:
        _print_table(found)
        spent = common.duration(elapsed_s)
        note("")
        note(f"trained for {common.count(steps, 'step')}, in {spent} ({name})")
    _say_how(found)
    _say_diverged(found)
    films = _films(run, bodies, video, seed=seed, **where) if video is not None else iter(())
    if track is None:
        deque(films, maxlen=0)
        return
    with trackers.named_errors(run, track), closing(trackers.open_tracker(run, track)) as tracker:
        tracker.table("evaluation", COLUMNS, _cells(found), steps)
        for film in films:
            with film.ending_in(tracker.films) as path:
                tracker.film(f"film/{film.body}", path, steps)


def _check_video(video: Path) -> None:
    from morphkit.errors import OutputError

    if video.suffix.lower() not in VIDEO_SUFFIXES:
        raise common.UsageError(f"--video {video} must end in {' or '.join(VIDEO_SUFFIXES)}.")
    if not video.parent.is_dir():
        raise OutputError(f"{video} cannot be written: there is no folder {video.parent}.")


def _row(result: RobotResult) -> dict[str, Any]:
    return {
        "robot": result.robot,
        "trained_on": result.trained_on,
        "mean": result.mean,
        "std": result.std,
        "returns": result.returns,
        "random_mean": result.random_mean,
        "random_interval": result.random_interval,
        "random_returns": result.random_returns,
        "normalized": result.normalized,
        "diverged": result.diverged,
        "random_diverged": result.random_diverged,
        "mirrored": result.mirrored,
        "rests": result.rests,
    }


def _cells(found: Sequence[RobotResult]) -> list[tuple[str, ...]]:
    rows: list[tuple[str, ...]] = []
    for result in found:
        low, high = result.random_interval
        rows.append(
            (
                result.robot,
                "yes" if result.trained_on else "no",
                f"{result.mean:.1f}",
                f"{result.std:.1f}",
                f"{result.random_mean:.1f}",
                f"{low:.1f} .. {high:.1f}",
                "-" if result.normalized is None else f"{result.normalized:.3f}",
            )
        )
    return rows


def _print_table(found: Sequence[RobotResult]) -> None:
    write(table(COLUMNS, _cells(found), right=COLUMNS[2:], dispensable=("std",), width=terminal_width()))


def _say_how(found: Sequence[RobotResult]) -> None:
    for result in found:
        if result.mirrored:
            note(f"{result.robot}: the policy acted as for its mirror image, which training knew better")
        if result.rests:
            note(f"{result.robot}: at rest, since training had none of their names: {', '.join(result.rests)}")


def _say_diverged(found: Sequence[RobotResult]) -> None:
    for result in found:
        for count, whose in ((result.diverged, ""), (result.random_diverged, " of the random policy")):
            if count:
                every = "every episode" if count == len(result.returns) else common.count(count, "episode")
                note(f"{result.robot}: {every}{whose} ended because the simulation diverged")


class _Film(NamedTuple):
    """An episode, and where its film was written."""

    body: str
    path: Path
    simulation: Simulation
    poses: np.ndarray
    fps: float

    def write(self, path: Path) -> Path:
        from morphkit.viewer.media import write_video
        from morphkit.viewer.render import render_frames

        frames = render_frames(self.simulation, self.poses, width=VIDEO_WIDTH, height=VIDEO_HEIGHT)
        return write_video(frames, path, self.fps)

    @contextmanager
    def ending_in(self, suffixes: Sequence[str]) -> Iterator[Path]:
        """The film as a file with one of these endings, which may be gone afterwards."""
        if self.path.suffix.lower() in suffixes:
            yield self.path
            return
        with TemporaryDirectory() as folder:
            yield self.write(Path(folder, f"film{suffixes[0]}"))


def _films(run: Path, bodies: Sequence[Description], video: Path, **options: Any) -> Iterator[_Film]:
    """Film an episode of each body; a warning where pictures cannot be made."""
    from morphkit.errors import DependencyError
    from morphkit.viewer.render import resample
    from morphkit_rl.evaluation.evaluate import record

    for body in bodies:
        path = video if len(bodies) == 1 else video.with_name(f"{video.stem}-{body.name}{video.suffix}")
        note(f"filming {body.name}")
        simulation, qpos, fps = record(run, body, **options)
        film = _Film(body.name, path, simulation, *resample(qpos, fps))
        try:
            film.write(path)
        except DependencyError as error:
            label("warning:", "yellow")
            note(f" no video: {error}")
            return
        note(f"video: {path}")
        yield film
