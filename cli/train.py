"""`morphkit train`: one policy for many bodies."""

from __future__ import annotations

import shlex
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from morphkit.utils.printable import one_line

from . import common
from .table import table
from .terminal import note, write
from .train_seeds import train_seeds

if TYPE_CHECKING:
    from morphkit_rl.training.progress import TrainSummary

EXAMPLES = (
    "morphkit train cheetah-family --run runs/first --hold-out cheetah-no-ffoot --steps 370000",
    "morphkit train my_robot.urdf --run runs/own --task locomotion --base planar --steps 500000",
    "morphkit train --run runs/first --resume",
    "morphkit train cheetah-family --run runs/three --seeds 3 --steps 370000 --ray",
    "morphkit train my_robot.xml --run runs/tuned --from zoo:cheetah-family --steps 200000",
)


def train(
    robots: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="ROBOT_OR_FOLDER_OR_MANIFEST",
            help="Shipped robots, URDF or MJCF files, folders of them, or manifests that morphkit ablate wrote.",
        ),
    ] = None,
    run: Annotated[Path, typer.Option(metavar="DIR", help="Folder of the run: settings, metrics, checkpoints.")] = ...,  # type: ignore[assignment]
    hold_out: Annotated[
        list[str] | None, typer.Option(metavar="NAME", help="Keep this body out of training. May be given often.")
    ] = None,
    validate: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME",
            help="Keep this body out of training too, but evaluate it every trainer.evaluate_steps steps, as the "
            "training bodies are. May be given often.",
        ),
    ] = None,
    minutes: Annotated[
        float | None, typer.Option(min=0, metavar="N", help="Stop after so many minutes of training.")
    ] = None,
    steps: Annotated[
        int | None,
        typer.Option(min=1, metavar="N", help="Stop after so many environment steps, summed over the bodies."),
    ] = None,
    preset: Annotated[
        str | None, typer.Option(help="Name of a preset, or a TOML file with settings.", show_default="default")
    ] = None,
    settings: Annotated[
        list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="Change a setting, such as td3.tau=0.01.")
    ] = None,
    seed: Annotated[int | None, typer.Option(help="Seed of all random numbers.", show_default="0")] = None,
    seeds: Annotated[
        int | None,
        typer.Option(min=1, metavar="N", help="Train N policies, with seeds from --seed on, each in DIR/seed-SEED."),
    ] = None,
    ray: common.RayOption = None,
    cpus: common.CpusOption = 1,
    start: Annotated[
        str | None,
        typer.Option(
            "--from",
            metavar="RUN",
            help="Go on from the policy of this run, or of zoo:NAME, on these bodies; settings are its own, where "
            "--preset and --set do not change them.",
        ),
    ] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Go on with the run in DIR where it stopped.")] = False,
    task: Annotated[
        str | None,
        typer.Option(
            metavar="NAME_OR_FILE",
            help="Task of all bodies, such as walk, or a TOML file. With --resume, the file whose Python terms "
            "the run needs.",
            show_default="what each robot says",
        ),
    ] = None,
    base: Annotated[
        Literal["planar", "free", "fixed"] | None,
        typer.Option(help="How the root is attached to the world, where the file leaves it open."),
    ] = None,
    encoder: common.EncoderOption = None,
    xacro_arg: common.XacroArgOption = None,
    trust_xacro: common.TrustXacroOption = False,
    strict: Annotated[
        bool, typer.Option("--strict", help="Refuse robots of which something has to be mended, as convert mends it.")
    ] = False,
    device: Annotated[str | None, typer.Option(help="PyTorch device, such as cpu or cuda.", show_default="cpu")] = None,
    track: common.TrackOption = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print the summary as JSON.")] = False,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Show no progress and no summary.")] = False,
) -> None:
    """Train one policy on many bodies at once.

    Ctrl-C stops a run at a checkpoint; --resume goes on from there exactly as if it had never
    stopped. The policy knows a body by the names of its sensors and actuators only, so that it can
    be tried on bodies that were held out: see morphkit evaluate.
    """
    arguments = {**locals(), "seeds": None, "ray": None}
    if seeds is not None:
        train_seeds(train, arguments, seeds, ray, cpus)
        return
    if ray is not None:
        raise common.UsageError("--ray goes with --seeds.")
    robots, hold_out, validate, settings = robots or [], hold_out or [], validate or [], settings or []
    settings = [*settings, f"trainer.track={track}"] if track and not resume else settings
    if resume:
        fixed = {
            "ROBOT": robots,
            "--hold-out": hold_out,
            "--validate": validate,
            "--preset": preset,
            "--set": settings,
            "--seed": seed is not None,
            "--from": start is not None,
            "--task": task and not task.endswith(".toml"),
            "--base": base,
            "--xacro-arg": xacro_arg,
            "--trust-xacro": trust_xacro,
            "--strict": strict,
            "--device": device,
            "--track": track,
        }
        given = [option for option, value in fixed.items() if value]
        if given:
            raise common.UsageError(f"a resumed run keeps its bodies and settings; leave out {', '.join(given)}.")
    elif encoder is not None and start is None:
        raise common.UsageError("--encoder goes with --resume or --from; else take --set text.encoder=NAME_OR_FOLDER.")
    elif not robots:
        raise common.UsageError("say what to train on: robots, files, folders or manifests.")
    bodies = common.load_bodies(robots, xacro_arg, trust_xacro=trust_xacro)

    from morphkit_rl.algorithms.fine_tuning import start_config
    from morphkit_rl.config.train_config import load_config
    from morphkit_rl.text.model_files import SHIPPED
    from morphkit_rl.training import trainer

    from .progress import ProgressDisplay

    learn: Callable[[ProgressDisplay], TrainSummary]
    if resume:

        def learn(display: ProgressDisplay) -> TrainSummary:
            own = Path(task) if task else None
            return trainer.resume(run, minutes=minutes, steps=steps, encoder=encoder, task=own, progress=display.update)

    else:
        if start is None:
            config = load_config("default" if preset is None else preset, settings)
        else:
            config = start_config(start, preset, settings, encoder=encoder)
        encoder = None if config.text.encoder == SHIPPED else config.text.encoder

        def learn(display: ProgressDisplay) -> TrainSummary:
            return trainer.train(
                bodies,
                run,
                config,
                hold_out=hold_out,
                validation=validate,
                task=task,
                base=base,
                seed=seed or 0,
                minutes=minutes,
                steps=steps,
                device="cpu" if device is None else device,
                start=start,
                strict=strict,
                progress=display.update,
                notice=display.say,
            )

    title = "resuming"
    if not resume:
        title = f"training on {common.count(len(bodies) - len(hold_out) - len(validate), 'body')}"
    for what, names in (("held out", hold_out), ("validated on", validate)):
        if names:
            title += f", {what}: {', '.join(names)}"
    with ProgressDisplay(title, quiet=quiet) as display:
        summary = learn(display)
    _report(summary, robots, encoder, as_json=as_json, quiet=quiet)


def _report(summary: TrainSummary, robots: list[str], encoder: str | None, *, as_json: bool, quiet: bool) -> None:
    trusted = ["--encoder", encoder] if encoder else []
    if as_json:
        common.print_json(
            {
                "run": str(summary.run),
                "steps": summary.steps,
                "real_steps": summary.real_steps,
                "updates": summary.updates,
                "elapsed_s": summary.elapsed_s,
                "interrupted": summary.interrupted,
                "advanced": summary.advanced,
                "diverged": summary.diverged,
                "returns": summary.returns,
                "first_returns": summary.first_returns,
            }
        )
    elif not quiet:
        groups = (("", summary.returns), ("first, shorter episodes, scaled up", summary.first_returns))
        rows = [(robot, f"{value:.1f}", what) for what, group in groups for robot, value in group.items()]
        columns = ("body", "training return", "of") if summary.first_returns else ("body", "training return")
        if rows:
            cells = [row[: len(columns)] for row in rows]
            write(table(columns, cells, right=["training return"]) + "\n")
        write(
            f"{common.count(summary.steps, 'step')} and {common.count(summary.updates, 'update')} "
            f"in {common.duration(summary.elapsed_s)}; run: {one_line(str(summary.run))}\n"
        )
    if summary.diverged:
        episodes = common.count(summary.diverged, "episode")
        note(f"{episodes} ended because the simulation diverged")
    if not summary.advanced:
        note("nothing left to do: the budget is used up; --steps or --minutes sets a larger one in all")
    if summary.interrupted:
        again = shlex.join(["--run", str(summary.run), "--resume", *trusted])
        note(f"stopped at a checkpoint; go on with: morphkit train {again}")
        raise KeyboardInterrupt
    if not quiet and not as_json:
        words = [str(summary.run), *(robots or ["ROBOT"]), *trusted]
        note(f"next: morphkit evaluate {shlex.join(words)}")
