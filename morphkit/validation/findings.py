"""What a check says: rules, which are data, and findings, which are rules met somewhere in a file."""

from __future__ import annotations

import tomllib
from collections import Counter
from dataclasses import dataclass, field
from functools import cache
from importlib.resources import files
from typing import Any, Literal, get_args

from morphkit.errors import UnknownNameError
from morphkit.utils.suggest import did_you_mean

Severity = Literal["error", "warning", "info"]
SEVERITIES: tuple[Severity, ...] = get_args(Severity)
"""Worst first."""

MAX_PER_RULE = 200
"""Findings of one rule that are kept for a file; more of them say nothing new."""


@dataclass(frozen=True, slots=True)
class Rule:
    """A kind of finding.

    Attributes:
        id: Short name, such as `limit-inverted`.
        severity: How bad it is: `error` breaks the robot in some tool, `warning` is probably a mistake, `info` is worth
            knowing.
        title: What is wrong, in one line.
        why: What comes of it.
        fix: What to do.
    """

    id: str
    severity: Severity
    title: str
    why: str
    fix: str


@dataclass(frozen=True, slots=True)
class Finding:
    """A rule that a file breaks at one place.

    Attributes:
        rule: Its id.
        severity: That of the rule.
        file: The file, as it was given; for included files its path seen from the main file.
        line: Line in `file`, from 1; None where no single line is to blame.
        message: What is wrong there, with names and numbers.
        element: Name of the link, joint, body, ... that it is about; empty where there is none.
        fix: What to do about it.
    """

    rule: str
    severity: Severity
    file: str
    line: int | None
    message: str
    element: str
    fix: str

    @property
    def place(self) -> str:
        """`file:line`."""
        return self.file if self.line is None else f"{self.file}:{self.line}"

    @property
    def why(self) -> str:
        """What comes of it."""
        return find_rule(self.rule).why


@dataclass
class Report:
    """All findings about one file, worst first and then in the order of the file.

    Attributes:
        file: The file, as it was given.
        format: `urdf` or `mjcf`; None where it is neither.
        findings: What was found.
        omitted: Rule -> number of further findings that were not kept.
    """

    file: str
    format: str | None = None
    findings: list[Finding] = field(default_factory=list)
    omitted: Counter[str] = field(default_factory=Counter)

    def count(self, severity: Severity) -> int:
        """Number of findings of a severity, those not kept included."""
        kept = sum(finding.severity == severity for finding in self.findings)
        return kept + sum(number for rule, number in self.omitted.items() if find_rule(rule).severity == severity)

    def add(
        self, rule_id: str, place: tuple[str, int | None], message: str, *, element: str = "", fix: str = ""
    ) -> None:
        """Enter a finding; `fix` says more than the rule's own where given."""
        rule = find_rule(rule_id)
        finding = Finding(rule_id, rule.severity, *place, message, element, fix or rule.fix)
        if finding in self.findings:
            return
        if sum(known.rule == rule_id for known in self.findings) >= MAX_PER_RULE:
            self.omitted[rule_id] += 1
            return
        self.findings.append(finding)

    def keep(self, severity: Severity) -> None:
        """Drop the findings that are less severe than `severity`."""
        wanted = SEVERITIES[: SEVERITIES.index(severity) + 1]
        self.findings = [found for found in self.findings if found.severity in wanted]
        self.omitted = Counter({rule: n for rule, n in self.omitted.items() if find_rule(rule).severity in wanted})

    def sort(self) -> None:
        """Bring the findings into their final order."""
        self.findings.sort(
            key=lambda each: (SEVERITIES.index(each.severity), each.file != self.file, each.file, each.line or 0)
        )

    def to_json(self) -> dict[str, Any]:
        """The report as JSON values."""
        return {
            "file": self.file,
            "format": self.format,
            "errors": self.count("error"),
            "warnings": self.count("warning"),
            "infos": self.count("info"),
            "findings": [
                {
                    "id": found.rule,
                    "severity": found.severity,
                    "file": found.file,
                    "line": found.line,
                    "element": found.element or None,
                    "message": found.message,
                    "why": found.why,
                    "fix": found.fix,
                }
                for found in self.findings
            ],
            "omitted": dict(self.omitted),
        }


@cache
def rules() -> dict[str, Rule]:
    """Every rule by its id, in the order of the reference."""
    text = files("morphkit.validation").joinpath("rules.toml").read_text("utf-8")
    return {rule: Rule(id=rule, **values) for rule, values in tomllib.loads(text).items()}


def find_rule(rule_id: str) -> Rule:
    """Return the rule `rule_id`.

    Raises:
        UnknownNameError: There is none; the message names the nearest.
    """
    known = rules()
    if rule_id not in known:
        raise UnknownNameError(f"no finding has the id {rule_id!r}{did_you_mean(rule_id, known)}")
    return known[rule_id]
