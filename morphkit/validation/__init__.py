"""Findings about robot description files: what is wrong, where, why it matters and how to mend it."""

from __future__ import annotations

from morphkit.validation.check import check
from morphkit.validation.findings import SEVERITIES, Finding, Report, Rule, Severity, find_rule, rules

__all__ = ["SEVERITIES", "Finding", "Report", "Rule", "Severity", "check", "find_rule", "rules"]
