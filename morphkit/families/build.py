"""Many variants of one robot: cut and compiled in worker processes, so that a crash of the simulator is one of them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from morphkit.ablation.ablate import Cutter, Variant
from morphkit.description import Description, RobotInfo
from morphkit.errors import DescriptionError
from morphkit.families.enumeration import Planned
from morphkit.families.scaled import scales_left
from morphkit.formats.isolation import working
from morphkit.readers import read
from morphkit.scaling.scale import scale_limbs, scaled_info
from morphkit.utils import worker_pool


@dataclass(frozen=True, slots=True)
class FailedVariant:
    """A variant that could not be made.

    Attributes:
        name: Its name.
        removed: The limbs that it was to lose, the topmost of each subtree.
        spliced: The limbs that were to be taken out from between.
        reason: Why: what MuJoCo says of it, or how MuJoCo crashed.
    """

    name: str
    removed: tuple[str, ...]
    spliced: tuple[str, ...]
    reason: str


@dataclass(frozen=True, slots=True)
class MirroredVariant:
    """A variant that was left out because it is the mirror image of another.

    Attributes:
        name: Its name.
        removed: The limbs that it would lose, the topmost of each subtree.
        mirrors: Name of the variant that stands for it.
    """

    name: str
    removed: tuple[str, ...]
    mirrors: str


Made = Variant | FailedVariant | MirroredVariant


def make(
    cutter: Cutter, planned: Iterable[Planned], *, jobs: int = 1, compiled: bool = True, drop_assets: bool = False
) -> Iterator[Made]:
    """Make variants, in the order planned whatever `jobs` is.

    Args:
        cutter: The robot.
        planned: What to make.
        jobs: Number of worker processes.
        compiled: Whether MuJoCo has to compile a variant; see `compile_problem`.
        drop_assets: As in `ablation.ablate`.
    """
    setup = partial(_cutting, _plain(cutter.description), compiled, drop_assets)
    pending = _Passing(planned)
    for plan, made in worker_pool.run(setup, pending.to_make(), jobs=jobs, limits=working(cutter.description)):
        yield from pending.left_out(plan)
        if isinstance(made, worker_pool.Failure):
            yield FailedVariant(plan.name, plan.remove, plan.splice, made.reason)
        else:
            yield _adopted(cutter, made)
    yield from pending.left_out(None)


def check_variant(variant: Variant) -> Variant | FailedVariant:
    """The variant, unless MuJoCo cannot compile it."""
    reason = compile_problem(variant.description)
    if not reason:
        return variant
    return FailedVariant(variant.description.name, variant.removed, variant.spliced, reason)


def compile_problem(description: Description) -> str:
    """Why MuJoCo cannot compile a description, or how it crashed doing so, in another process; empty where it can.

    Where the source of variants has such a problem, say a mesh that is missing, its variants cannot be held to it.
    """
    ((_, result),) = worker_pool.run(_compiling, [_plain(description)], limits=working(description))
    return result.reason if isinstance(result, worker_pool.Failure) else ""


def servo_gains(description: Description) -> dict[str, tuple[float, float]]:
    """Stiffness and damping of each joint that position actuation gives a servo, found in another process.

    Those that `robot.toml` gives are kept as they are. Empty where motors are not driven by position unless somebody
    asks for it, and where the robot cannot be simulated.
    """
    given, asked = description.info.gains, description.info.actuation
    by_default = description.format == "urdf" and read(description).base == "free"
    if asked not in (None, "position") or (asked is None and not by_default):
        return given
    ((_, result),) = worker_pool.run(_finding_gains, [_plain(description)], limits=working(description))
    found = {} if isinstance(result, worker_pool.Failure) else result
    return {**given, **{joint: gains for joint, gains in found.items() if joint not in given}}


def load_problems(files: Iterable[Path], source: Description, *, jobs: int = 1) -> Iterator[tuple[Path, str]]:
    """Yield each written variant of `source` that MuJoCo alone cannot load, and why, or how it crashed doing so."""
    for path, result in worker_pool.run(_loading, files, jobs=jobs, limits=working(source)):
        if isinstance(result, worker_pool.Failure):
            yield path, result.reason


class _Passing:
    """Takes what is left out from between what is made, and puts it back in its place afterwards."""

    def __init__(self, planned: Iterable[Planned]) -> None:
        self._planned = planned
        self._skipped: list[tuple[Planned | None, list[Planned]]] = []

    def to_make(self) -> Iterator[Planned]:
        before: list[Planned] = []
        for plan in self._planned:
            if plan.mirrors is not None:
                before.append(plan)
                continue
            self._skipped.append((plan, before))
            before = []
            yield plan
        self._skipped.append((None, before))

    def left_out(self, until: Planned | None) -> Iterator[MirroredVariant]:
        """What was left out right before `until`; None stands for the end."""
        plan, skipped = self._skipped.pop(0)
        assert plan == until
        for each in skipped:
            assert each.mirrors is not None
            yield MirroredVariant(each.name, each.remove, each.mirrors)


def _adopted(cutter: Cutter, made: Variant) -> Variant:
    variant = cutter.adopt(made)
    if not made.scaled:
        return variant
    info = scaled_info(variant.description.info, cutter.morphology, made.scaled)
    return replace(variant, description=replace(variant.description, info=info))


def _plain(description: Description) -> Description:
    """A description that can be sent to another process."""
    return replace(description, packages=dict(description.packages))


def _cutting(description: Description, compiled: bool, drop_assets: bool) -> Callable[[Planned], Variant]:
    cutter = Cutter(description)
    compile_one = _compiling()

    def make_one(plan: Planned) -> Variant:
        variant = cutter.cut(remove=plan.remove, splice=plan.splice, drop_assets=drop_assets, name=plan.name)
        if plan.scales:
            variant = scale_limbs(variant, scales_left(plan, variant), name=plan.name)
        if compiled:
            compile_one(variant.description)
        # What all variants share is not sent back.
        return replace(variant, description=replace(variant.description, info=RobotInfo(), folder=None, packages={}))

    return make_one


def _compiling() -> Callable[[Description], None]:
    from morphkit.simulation.build import compile_plain

    def compile_one(description: Description) -> None:
        compile_plain(description)

    return compile_one


def _finding_gains() -> Callable[[Description], dict[str, tuple[float, float]]]:
    from morphkit.simulation.build import build_simulation

    def find(description: Description) -> dict[str, tuple[float, float]]:
        gains = build_simulation(description, actuation="position").gains
        return {joint: (each.stiffness, each.damping) for joint, each in gains.items()}

    return find


def _loading() -> Callable[[Path], None]:
    import mujoco

    def load_one(path: Path) -> None:
        try:
            mujoco.MjModel.from_xml_path(str(path.absolute()))
        except ValueError as error:
            raise DescriptionError(" ".join(str(error).removeprefix("Error: ").split())) from None

    return load_one
