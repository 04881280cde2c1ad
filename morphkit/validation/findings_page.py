"""The reference of findings, docs/findings.md, made of the rules."""

from __future__ import annotations

from morphkit.validation.findings import SEVERITIES, rules

_HEAD = """\
# Findings

<!-- Made by: python -m morphkit.validation.findings_page > docs/findings.md -->

`morphkit check FILE...` looks for what is wrong, or probably wrong, in URDF and MJCF files, and says where, why it
matters and how to mend it. It goes on after the first mistake: everything that can still be looked at is looked at.

```console
$ morphkit check robot.urdf                    # exit code 1 where a file has an error, else 0; 2 if unreadable
$ morphkit check robot.xml --severity warning  # without what is only worth knowing
$ morphkit check *.urdf --json                 # for programs
$ morphkit check robot.urdf --sarif out.sarif  # for code hosts, which show findings next to the lines (SARIF 2.1.0)
$ morphkit check robot.urdf --format sarif     # the same on stdout; so does --sarif -
$ morphkit check --explain limit-inverted      # one entry of this page
```

Meshes are read, and MJCF is compiled, in a process of its own with bounded time and memory, since files from strangers
can bring such libraries down; `--quick` leaves both out. URDF is judged by its own rules, not by MuJoCo's importer.
Lines are those of the file that holds the element, included files among them. A name of a shipped robot works in
place of a file.

An **error** breaks the robot in some tool, a **warning** is probably a mistake, an **info** is worth knowing. Masses
and inertias of links that weigh less than 2 % of what they are fixed to are not compared with their shapes: such links
are taken for frames. Of one kind at most 200 findings a file are listed; the rest are counted.
"""


def reference() -> str:
    """The page, in Markdown."""
    parts = [_HEAD, "| id | severity | what |\n|---|---|---|\n"]
    ordered = sorted(rules().values(), key=lambda rule: SEVERITIES.index(rule.severity))
    parts[1] += "".join(f"| [{rule.id}](#{rule.id}) | {rule.severity} | {_safe(rule.title)} |\n" for rule in ordered)
    for rule in rules().values():
        title, why, fix = map(_safe, (rule.title, rule.why, rule.fix))
        parts.append(f"## {rule.id}\n\n{title} ({rule.severity}).\n\n- Why: {why}\n- Fix: {fix}\n")
    return "\n".join(parts)


def _safe(text: str) -> str:
    """`text` with elements as code, which Markdown would take for HTML."""
    words = text.replace("<", "`<").replace(">", ">`").replace("``", "")
    return words.replace("xacro robot.urdf.xacro >` robot.urdf", "`xacro robot.urdf.xacro > robot.urdf`")


if __name__ == "__main__":
    print(reference(), end="")
