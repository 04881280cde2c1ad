"""The check of one file: every part of it that can be looked at is looked at, whatever else is broken."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

from morphkit import robot_toml
from morphkit.description import RobotInfo
from morphkit.errors import DescriptionError
from morphkit.families.manifest import find_listed
from morphkit.formats.mjcf_schema import EXPANDERS
from morphkit.formats.srdf import start_state
from morphkit.validation import (
    mjcf_assets,
    mjcf_references,
    mjcf_values,
    urdf_inertia,
    urdf_joints,
    urdf_links,
    urdf_repairs,
    urdf_tree,
)
from morphkit.validation.document import CheckedDocument, elements, open_document
from morphkit.validation.findings import Report
from morphkit.validation.meshes import MeshFacts, MeshUse, check_meshes
from morphkit.validation.sandbox import Answer, probe

Start = str | dict[str, float]
_NO_PACKAGES: Mapping[str, Path] = MappingProxyType({})
_NO_ARGUMENTS: Mapping[str, str] = MappingProxyType({})


def check(
    path: str | Path,
    *,
    packages: Mapping[str, Path] = _NO_PACKAGES,
    xacro_args: Mapping[str, str] = _NO_ARGUMENTS,
    trust_xacro: bool = False,
    shown: str | None = None,
    deep: bool = True,
) -> Report:
    """Check a URDF or MJCF file.

    Args:
        path: The file.
        packages: Folder of each ROS package or Gazebo model that may be read, by name.
        xacro_args: Values of a xacro file's arguments, by name.
        trust_xacro: Whether a xacro file may do all that the library lets it do.
        shown: What the file is called in findings; None for `path`.
        deep: Whether meshes are read, MJCF is compiled and URDF is converted, in a process of its own.

    Returns:
        The findings; a file that is no XML or no robot is one as well.

    Raises:
        DescriptionError: There is no such file, or it or the `robot.toml` or manifest next to it cannot be
            read.
        DependencyError: The library that expands xacro is missing.
        UnknownNameError: The xacro file has no argument of a name in `xacro_args`.
    """
    path = Path(path)
    report = Report(shown if shown is not None else str(path))
    try:
        info, packages = _beside(path, packages)
        doc = open_document(path, report, packages, xacro_args, trust_xacro=trust_xacro)
    except OSError as error:
        raise DescriptionError(f"{path}: cannot be read: {error.strerror or error}") from error
    if doc is not None and report.format == "urdf":
        _check_urdf(doc, path, info, deep=deep)
    elif doc is not None:
        _check_mjcf(doc, path, info.start, deep=deep)
    report.sort()
    return report


def _check_urdf(doc: CheckedDocument, path: Path, info: RobotInfo, *, deep: bool) -> None:
    urdf_tree.check_xacro(doc)
    urdf_repairs.check_repairs(doc)
    tree = urdf_tree.read_tree(doc)
    urdf_tree.check_references(doc, tree)
    start = start_state(path, doc.document, info.start)
    urdf_joints.check_joints(doc, tree, start)
    inertials, uses = urdf_links.check_links(doc, tree)
    answer = _probe_urdf(doc, path, _read(uses), start) if deep else Answer()
    check_meshes(doc, uses, answer.meshes)
    urdf_inertia.check_masses(doc, tree, inertials, uses, answer.meshes)
    found = answer.robot or {}
    if found.get("refused") and not doc.report.count("error"):
        doc.add("simulator-refuses", doc.root, f"'morphkit convert' refuses the robot: {found['refused']}")
    urdf_links.check_overlaps(doc, tree, found.get("touching", ()))
    if info.base in (None, "free"):
        urdf_links.check_balance(doc, found.get("tips_at"))
    _check_death(doc, answer)


def _probe_urdf(doc: CheckedDocument, path: Path, meshes: Sequence[Path], start: Start) -> Answer:
    """Measure meshes, and convert the robot where nothing is known yet that hinders it."""
    if doc.report.count("error"):
        return probe(meshes)
    file = path.name.encode(errors="replace").decode()  # a name that is no text is no fault of the robot
    return probe(
        meshes, robot={"file": file, "source": doc.document.source.decode("latin-1"), **_folders(doc), "start": start}
    )


def _read(uses: Iterable[MeshUse]) -> list[Path]:
    """The mesh files of some uses, once for each scale."""
    return [path for path, _ in dict.fromkeys((use.path, tuple(use.scale)) for use in uses)]


def _folders(doc: CheckedDocument) -> dict[str, Any]:
    """Where assets are, as JSON values."""
    packages = {name: str(folder.resolve()) for name, folder in doc.packages.items()}
    return {"folder": str(doc.folder.resolve()), "packages": packages}


def _beside(path: Path, packages: Mapping[str, Path]) -> tuple[RobotInfo, Mapping[str, Path]]:
    """What a `robot.toml` or a manifest next to the file says of the robot, and what may be read for the file."""
    beside = path.parent / robot_toml.FILE_NAME
    toml = robot_toml.read_robot_toml(beside) if beside.is_file() else None
    if toml is not None and toml.file == path.name:
        return toml.info, packages
    listed = find_listed(path)
    if listed is None:
        return RobotInfo(), packages
    manifest, _ = listed
    return manifest.info, {**manifest.readable(), **packages}


def _check_mjcf(doc: CheckedDocument, path: Path, start: Start, *, deep: bool) -> None:
    mjcf_values.check_numbers(doc)
    inertials = mjcf_values.check_inertials(doc)
    meshes = mjcf_assets.find_meshes(doc)
    text, lines = mjcf_references.numbered(doc.root)
    answer = Answer()
    if deep:
        model = {"source": text, "file": path.name, **_folders(doc), "start": start}
        answer = probe(_read(meshes.values()), model=model)
    found = answer.model or {}
    mjcf_references.check_names(doc, found.get("names"))
    mjcf_references.check_unused(doc)
    mjcf_values.check_keyframes(doc, found.get("sizes"))
    facts: Mapping[str, MeshFacts] = answer.meshes
    check_meshes(doc, list(meshes.values()), facts)
    mjcf_assets.check_bodies(doc, inertials, meshes, facts)
    tops = [body for world in elements(doc.root, "worldbody") for body in elements(world, "body")]
    if len(tops) > 1:
        names = ", ".join(repr(body.get("name") or "") for body in tops[:8])
        doc.add("bodies-several", tops[1], f"{len(tops)} bodies hang on the world: {names}")
    elif not tops and next(doc.root.iter(*EXPANDERS), None) is None and doc.complete:
        doc.add("robot-empty", doc.root, "no <body> in <worldbody>")
    if answer.model is not None:
        mjcf_values.check_model(doc, answer.model, lines)
    _check_death(doc, answer)


def _check_death(doc: CheckedDocument, answer: Answer) -> None:
    if answer.died:
        doc.report.add("simulator-crash", (doc.report.file, None), answer.died)
