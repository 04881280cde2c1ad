"""A description file and what it includes as one tree, every element of which knows its file and line."""

from __future__ import annotations

import os
import posixpath
import re
from collections.abc import Mapping
from errno import EISDIR, ENXIO
from pathlib import Path
from typing import Any

from morphkit.errors import AssetError, DescriptionError
from morphkit.formats import xml
from morphkit.formats.document import Document
from morphkit.formats.mjcf_include import IncludeProblem, flatten_includes
from morphkit.formats.resolve import resolve_asset
from morphkit.formats.xacro import expand
from morphkit.validation.findings import Report

_MAX_HINTS = 50
_PLACE = re.compile(r"^(?P<file>.*?):(?P<line>\d+): (?P<reason>.*)$", re.DOTALL)


class CheckedDocument:
    """A parsed description that reports what is wrong with it.

    Attributes:
        document: The main file as it was parsed.
        root: The root element of a copy, MJCF includes replaced by what they hold.
        folder: The folder of the main file.
        packages: Folder of each package that the user named.
        report: Receives the findings.
        complete: Whether every include could be followed; where not, unknown names prove nothing.
        hints_left: For how many more unknown names the nearest one is looked for, which takes time.
    """

    def __init__(
        self, document: Document, path: Path, report: Report, packages: Mapping[str, Path], *, lines: bool
    ) -> None:
        self.document = document
        self.root: Any = document.copy().getroot()
        self.folder = path.parent
        self.packages = packages
        self.report = report
        self.complete = True
        self.hints_left = _MAX_HINTS
        self._lines = lines
        self._file_of: dict[int, str] = {}
        self._held: list[Any] = []  # keeps lxml's proxies alive, so that id() identifies an element
        self._enter(self.root, report.file)
        self._follow_includes()

    def place(self, element: Any) -> tuple[str, int | None]:
        """File and line of an element."""
        return self._file_of.get(id(element), self.report.file), element.sourceline if self._lines else None

    def add(self, rule: str, element: Any, message: str, *, name: str = "", fix: str = "") -> None:
        """Report a finding at `element`."""
        self.report.add(rule, self.place(element), message, element=name, fix=fix)

    def locate(self, reference: str) -> Path:
        """The file that `reference` means; AssetError where there is none."""
        return resolve_asset(reference, self.folder, packages=self.packages)

    def find_asset(self, element: Any, reference: str, owner: str, name: str, *, missing: str) -> Path | None:
        """The file that `reference` means; None where there is none or it may not be read, which is reported.

        Args:
            element: Where it is named.
            reference: What the description says.
            owner: What needs it, for the message.
            name: Name of the link or asset.
            missing: The rule to report where there is no such file.
        """
        try:
            return self.locate(reference)
        except AssetError as error:
            rule = "file-outside" if "(outside, refused)" in str(error) else missing
            self.add(rule, element, f"{owner}: {one_line(error)}", name=name)
            return None

    def _enter(self, element: Any, file: str) -> None:
        for each in element.iter():
            self._held.append(each)
            self._file_of[id(each)] = file

    def _follow_includes(self) -> None:
        flatten_includes(
            self.root.getroottree(),
            self.folder,
            file=self.report.file,
            packages=self.packages,
            part=lambda file: self.document.part(file).copy(),
            read=lambda root, path: self._enter(root, self._shown(path)),
            problem=self._add_include,
        )

    def _add_include(self, problem: IncludeProblem) -> None:
        self.complete = False
        if problem.kind == "malformed" and problem.path is not None:
            _, line, reason = split_message(problem.error)
            self.report.add("xml-malformed", (self._shown(problem.path), line), reason)
        elif problem.kind == "repeated":
            self.add("include-repeated", problem.element, f"{problem.element.get('file')!r} is included again")
        else:
            self.add("include-missing", problem.element, " ".join(problem.reason.split()))

    def _shown(self, path: Path) -> str:
        """What an included file is called in findings: its path as seen from where the main file's is."""
        relative = os.path.relpath(path, self.folder.resolve())
        return posixpath.join(posixpath.dirname(self.report.file), Path(relative).as_posix())


def open_document(
    path: Path,
    report: Report,
    packages: Mapping[str, Path],
    xacro_args: Mapping[str, str],
    *,
    trust_xacro: bool = False,
) -> CheckedDocument | None:
    """Parse a description file; None where it is none, which the report then says.

    A `.xacro` file is expanded first; its findings name no lines, because those of the text it makes mean nothing.

    Raises:
        OSError: The file cannot be read.
        DependencyError: The library that expands xacro is missing.
        UnknownNameError: The xacro file has no argument of a name in `xacro_args`.
    """
    if not path.is_file():
        raise IsADirectoryError(EISDIR, os.strerror(EISDIR)) if path.is_dir() else OSError(ENXIO, "no regular file")
    try:
        expanded = path.suffix == ".xacro"
        source = expand(path, packages, xacro_args, trusted=trust_xacro) if expanded else xml.read_limited(path)
        document = Document(source, file=report.file)
    except DescriptionError as error:
        _, line, reason = split_message(error)
        fix = "Say --trust-xacro, if you trust the file." if "--trust-xacro" in reason else ""
        report.add("xml-malformed", (report.file, line), reason, fix=fix)
        return None
    try:
        report.format = document.format
    except DescriptionError as error:
        _, line, reason = split_message(error)
        report.add("root-element", (report.file, line), reason)
        return None
    return CheckedDocument(document, path, report, packages, lines=not expanded)


def split_message(error: Exception) -> tuple[str, int | None, str]:
    """Take the message of a DescriptionError apart: file, line, reason."""
    match = _PLACE.match(str(error))
    if match is None:
        return "", None, one_line(error)
    return match["file"], int(match["line"]), match["reason"]


def one_line(error: Exception) -> str:
    """The message of an error on one line."""
    return " ".join(str(error).split())


def elements(parent: Any, *tags: str) -> list[Any]:
    """Child elements of `parent` with one of the tags, comments left out."""
    return [child for child in parent if isinstance(child.tag, str) and (not tags or child.tag in tags)]
