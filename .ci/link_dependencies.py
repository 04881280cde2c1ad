"""Give a new virtual environment what a wheel requires, and nothing else, by hard links from this environment.

    python .ci/link_dependencies.py WHEEL ENVIRONMENT [EXTRA]...

Installing PyTorch and the rest a second time takes minutes; `pip check` afterwards sees whether anything is missing.
"""

from __future__ import annotations

import os
import shutil
import sys
import zipfile
from importlib.metadata import Distribution, PathDistribution, distribution
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name


def required(dist: Distribution, extras: frozenset[str], found: dict[str, Distribution]) -> dict[str, Distribution]:
    """Add what a distribution requires with these extras, directly or not, to `found`, by name and extras."""
    for text in dist.requires or ():
        requirement = Requirement(text)
        if requirement.marker and not any(requirement.marker.evaluate({"extra": extra}) for extra in extras | {""}):
            continue
        key = f"{canonicalize_name(requirement.name)}{sorted(requirement.extras)}"
        if key not in found:
            found[key] = distribution(requirement.name)
            required(found[key], frozenset(requirement.extras), found)
    return found


def link(dist: Distribution, site: Path) -> None:
    """Link a distribution's modules and data; its commands are left out."""
    for file in dist.files or ():
        target, source = site / str(file), Path(str(dist.locate_file(file)))
        if ".." in Path(str(file)).parts or not source.is_file() or target.exists():
            continue
        target.parent.mkdir(parents=True, exist_ok=True)
        try:
            os.link(source, target)
        except OSError:  # on another disk
            shutil.copy2(source, target)


def main() -> None:
    """Link what the wheel requires."""
    wheel, environment = map(Path, sys.argv[1:3])
    (site,) = (environment / "lib").glob("python3*/site-packages")
    with zipfile.ZipFile(wheel) as archive:
        (metadata,) = (name for name in archive.namelist() if name.endswith(".dist-info/METADATA"))
        about = PathDistribution(zipfile.Path(archive, metadata.removesuffix("METADATA")))
        for dist in required(about, frozenset(sys.argv[3:]), {}).values():
            link(dist, site)


if __name__ == "__main__":
    main()
