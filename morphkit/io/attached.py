"""The models that an MJCF file attaches: MuJoCo opens them itself while it parses, so they are looked at first."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from lxml import etree

from morphkit.description import Description
from morphkit.errors import AssetError, DescriptionError
from morphkit.io import xml
from morphkit.io.limits import check_mjcf
from morphkit.io.resolve import flatten_includes, locate


def locate_models(tree: etree._ElementTree, description: Description) -> None:
    """Make the paths of models to attach absolute, in place, and check those models and all that they attach.

    Raises:
        AssetError: One of them, or a file that it includes, is missing or may not be read.
        DescriptionError: One is no MJCF, breaks a limit, or attaches itself: MuJoCo would not survive that.
    """
    _follow(tree, description, ())


def _follow(tree: etree._ElementTree, description: Description, above: tuple[Path, ...]) -> None:
    for model in tree.iterfind("asset/model[@file]"):
        where = f"{description.file}:{model.sourceline}"
        try:
            path = locate(model.get("file") or "", description)
        except AssetError as error:
            raise AssetError(f"{where}: {error}") from None
        if path in above:
            raise DescriptionError(f"{where}: {path.name} attaches itself, through {abridged_path(above, path)}")
        model.set("file", str(path))
        try:
            source = xml.read_limited(path)
        except OSError as error:
            raise AssetError(f"{where}: {path} cannot be read: {error.strerror}") from None
        part = xml.parse(source, file=path.name)
        if xml.root_format(part, file=path.name) != "mjcf":
            continue  # MuJoCo attaches a URDF too, which includes and attaches nothing
        nested = replace(description, file=path.name, source=source)
        flatten_includes(part, path.parent, file=path.name, packages=_readable(description))
        check_mjcf(part.getroot(), file=path.name)
        _follow(part, replace(nested, folder=path.parent, packages=_readable(description)), (*above, path))


def abridged_path(above: tuple[Path, ...], end: Path) -> str:
    """`a.xml -> b.xml -> a.xml`."""
    return " -> ".join(path.name for path in (*above[above.index(end) :], end))


def _readable(description: Description) -> dict[str, Path]:
    """The packages and the robot's own folder, which models in folders below may refer to."""
    own = {} if description.folder is None else {"": description.folder.resolve()}
    return {**own, **description.packages}
