"""`morphkit check`: what is wrong with robot description files."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from . import common
from .terminal import assembled, line, write

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from rich.table import Table

    from morphkit.validation.findings import Report, Severity

SCHEMA_VERSION = 1
COLORS = {"error": "bold red", "warning": "yellow", "info": "cyan"}

EXAMPLES = (
    "morphkit check my_robot.urdf",
    "morphkit check *.xml --severity warning --sarif findings.sarif",
    "morphkit check my_robot.urdf --package my_robot_description=~/ws/src/my_robot --json",
    "morphkit check --explain inertia-triangle",
)


def check(
    files: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="FILE...", help="URDF or MJCF files; names of shipped robots work too.", show_default=False
        ),
    ] = None,
    severity: Annotated[
        Literal["error", "warning", "info"], typer.Option(help="Leave out findings less severe than this.")
    ] = "info",
    output: Annotated[
        Literal["text", "json", "sarif"] | None,
        typer.Option(
            "--format",
            help="What to print; SARIF 2.1.0 is what code hosts show next to lines.",
            show_default="text",
        ),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="The same as --format json.")] = False,
    sarif: Annotated[
        Path | None,
        typer.Option(metavar="OUT", help="Also write the findings as SARIF to a file; '-' is --format sarif."),
    ] = None,
    explain: Annotated[
        str | None, typer.Option(metavar="ID", help="Say what a finding means and how to mend it, and stop.")
    ] = None,
    quick: Annotated[
        bool, typer.Option("--quick", help="Look at the text only: neither read meshes nor compile MJCF.")
    ] = False,
    package: common.PackageOption = None,
    xacro_arg: common.XacroArgOption = None,
    trust_xacro: common.TrustXacroOption = False,
) -> None:
    """Look for mistakes in robot description files, and say where they are, why they matter and how to mend them.

    Exit code 0 where no file has an error, 1 where one has, 2 where one cannot be read.
    """
    printed = _printed(output, as_json=as_json, sarif=sarif)
    if explain is not None:
        if files or sarif is not None or printed == "sarif":
            raise common.UsageError("--explain takes no files and no --format sarif.")
        _explain(explain, as_json=printed == "json")
        return
    if not files:
        raise common.UsageError("say which files to check, or which finding to --explain.")
    from morphkit.errors import DescriptionError, MorphkitError
    from morphkit.formats.packages import parse_packages

    packages = parse_packages(package or [])
    arguments = common.xacro_arguments(xacro_arg, *files)
    reports: list[Report] = []
    unreadable: list[MorphkitError] = []  # the other files are checked all the same
    for file in dict.fromkeys(files):
        try:
            reports.append(_check(file, packages, arguments[file], severity, deep=not quick, trust_xacro=trust_xacro))
        except MorphkitError as error:
            unreadable.append(error)
    if reports:
        if sarif is not None and str(sarif) != "-":
            common.write_text(sarif, _sarif(reports))
        if printed == "sarif":
            write(_sarif(reports))
        elif printed == "json":
            common.print_json({"schema_version": SCHEMA_VERSION, "files": [report.to_json() for report in reports]})
        else:
            _print(reports)
    if unreadable:
        raise DescriptionError("\n  ".join(map(str, unreadable)))
    if any(report.count("error") for report in reports):
        raise typer.Exit(1)


def _printed(output: str | None, *, as_json: bool, sarif: Path | None) -> str:
    """What goes to stdout: `text`, `json` or `sarif`."""
    asked = {"json"} if as_json else set()
    if output is not None:
        asked.add(output)
    if sarif is not None and str(sarif) == "-":
        asked.add("sarif")
    if len(asked) > 1:
        raise common.UsageError(f"only one of {' and '.join(sorted(asked))} can be printed; name a file for SARIF.")
    return next(iter(asked), "text")


def _sarif(reports: Sequence[Report]) -> str:
    from morphkit.validation.sarif import to_sarif

    return json.dumps(to_sarif(reports), indent=2) + "\n"


def _check(
    file: str,
    packages: Mapping[str, Path],
    xacro_args: Mapping[str, str],
    severity: Severity,
    *,
    deep: bool,
    trust_xacro: bool,
) -> Report:
    from morphkit.errors import DescriptionError
    from morphkit.validation.check import check as check_file

    path, shown = Path(file), file
    if not path.exists():
        from morphkit.registry import load

        robot = load(file)
        path, shown = Path(robot.folder or "", robot.file), robot.file
        if not path.is_file():
            raise DescriptionError(
                f"{file}: is cut when it is asked for; write it with 'morphkit ablate', then check it"
            )
    report = check_file(path, packages=packages, xacro_args=xacro_args, trust_xacro=trust_xacro, shown=shown, deep=deep)
    report.keep(severity)
    return report


def _explain(rule_id: str, *, as_json: bool) -> None:
    from morphkit.validation.findings import find_rule

    rule = find_rule(rule_id)
    if as_json:
        common.print_json(
            {"id": rule.id, "severity": rule.severity, "title": rule.title, "why": rule.why, "fix": rule.fix}
        )
        return
    from rich.text import Text

    from .terminal import show

    head = Text.assemble((rule.id, "bold"), "  ", (rule.severity, COLORS[rule.severity]))
    show(Text("\n").join([head, Text(rule.title), Text(f"Why: {rule.why}"), Text(f"Fix: {rule.fix}")]))


def _print(reports: Sequence[Report]) -> None:
    from rich.console import Group

    from .terminal import show

    for report in reports:
        if report.findings:
            show(Group(_table(report), _advice(report)))
        for rule, number in report.omitted.items():
            show(line(f"{report.file}: {number} more of {rule}"))
    for report in reports:
        counts = [(report.count(level), level) for level in ("error", "warning", "info")]
        said = ", ".join(_counted(number, level) for number, level in counts if number)
        style = next((COLORS[level] for number, level in counts if number), "green")
        show(assembled(f"{report.file}: ", (said or "no findings", style)))


def _counted(number: int, level: str) -> str:
    return f"{number} info" if level == "info" else common.count(number, level)


def _table(report: Report) -> Table:
    from rich.table import Table

    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0), show_header=False)
    for _ in range(3):
        table.add_column(no_wrap=True)
    table.add_column(overflow="fold", ratio=1)
    for found in report.findings:
        severity = line(found.severity, COLORS[found.severity])
        table.add_row(severity, line(found.place), line(found.rule, "bold"), line(found.message))
    return table


def _advice(report: Report) -> Table:
    """What to do about each kind of finding, said once."""
    from rich.table import Table
    from rich.text import Text

    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 2), show_header=False, title_justify="left")
    table.title = Text("\nWhat to do", style="bold")
    table.add_column(no_wrap=True)
    table.add_column(overflow="fold")
    for rule, fix in dict.fromkeys((found.rule, found.fix) for found in report.findings):
        table.add_row(Text(rule, style="bold"), Text(fix))
    return table
