"""A comparison for the terminal: one tree of both robots' limbs, with what went, came and changed."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Sequence

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text
from rich.tree import Tree

from morphkit.comparison.compare import Change, Comparison, counts
from morphkit.comparison.properties import Value
from morphkit.morphology import Morphology
from morphkit.utils.printable import one_line

from .terminal import assembled, line

_GONE, _NEW, _CHANGED, _QUIET, _BOLD = "red", "green", "yellow", "dim", "bold"
_SIGNS = {"removed": ("-", _GONE), "added": ("+", _NEW)}
_TOKENS = ("sensor token", "actuator token")
_ANGLES = ("range", "bounds")
_NAMED = 6

_Node = tuple[bool, str]
"""Whether only the second robot has a limb, and its name there; else its name in the first."""


def render(comparison: Comparison) -> RenderableType:
    """What `morphkit diff` prints: both robots in numbers, then the tree. Signs tell what colors tell."""
    parts: list[RenderableType] = [_numbers(comparison), Text()]
    if comparison.equal:
        return Group(*parts, Text("no difference in limbs, joints, actuators, masses and tokens", style=_NEW))
    if not comparison.limbs:
        parts += [Text("no limb of one is found in the other: two unrelated robots", style=_CHANGED), Text()]
    return Group(*parts, _tree(comparison))


def _numbers(comparison: Comparison) -> Table:
    first, second = comparison.first, comparison.second
    table = Table(box=None, pad_edge=False, header_style=_BOLD)
    for heading, side in (("", "left"), (_title(first.morphology), "right"), (_title(second.morphology), "right")):
        table.add_column(heading, justify="left" if side == "left" else "right", overflow="fold")
    table.add_column("", justify="right")
    before, after = counts(first), counts(second)
    for name, one in before.items():
        other = after[name]
        change = Text()
        if one is not None and other is not None and not math.isclose(one, other, rel_tol=1e-6):
            change = line(f"{other - one:+.4g}", _NEW if other > one else _GONE)
        unit = ", kg" if name == "mass" else ""
        table.add_row(name.replace("_", " ") + unit, _number(one), _number(other), change)
    return table


def _title(robot: Morphology) -> str:
    return one_line(f"{robot.name} ({robot.format.upper()})")


def _number(value: float | None) -> str:
    return "unknown" if value is None else f"{value:.5g}"


class _Merged:
    """Limbs of both robots in one tree.

    Attributes:
        children: Limb, None for the world -> what hangs on it, in order.
        changes: Limb, None for what belongs to no single one -> what changed there.
    """

    def __init__(self, comparison: Comparison) -> None:
        nodes: dict[str | None, _Node | None] = {new: (False, old) for old, new in comparison.limbs.items()}
        nodes[None] = None
        self.children: dict[_Node | None, list[_Node]] = {}
        self.changes: dict[_Node | None, list[Change]] = {}
        for limb in comparison.second.morphology.limbs:
            node = nodes.setdefault(limb.name, (True, limb.name)) or (True, limb.name)
            self.children.setdefault(nodes[limb.parent], []).append(node)
        for limb in comparison.first.morphology.limbs:
            if limb.name not in comparison.limbs:
                parent = None if limb.parent is None else (False, limb.parent)
                self.children.setdefault(parent, []).append((False, limb.name))
        for change in comparison.changes:
            old = None if change.limb is None else (False, change.limb)
            self.changes.setdefault(nodes[change.limb] if change.kind == "added" else old, []).append(change)

    def below(self, node: _Node) -> list[_Node]:
        """A limb and all limbs below it."""
        found = [node]
        for limb in found:  # It grows on the way.
            found += self.children.get(limb, [])
        return found

    def touched(self, node: _Node) -> bool:
        """Whether anything changed at a limb or below it."""
        return any(limb in self.changes for limb in self.below(node))


def _tree(comparison: Comparison) -> Tree:
    merged = _Merged(comparison)
    tree = Tree(Text("limbs", style=_BOLD), guide_style=_QUIET)
    for change in merged.changes.get(None, []):
        if change.subject == "robot":
            tree.add(_changed(change))
    pending = [(tree, node) for node in reversed(merged.children.get(None, []))]
    while pending:
        above, node = pending.pop()
        branch = above.add(_limb(node[1], merged.changes.get(node, []), comparison))
        children = merged.children.get(node, [])
        untouched = [child for child in children if not merged.touched(child)]
        if untouched:
            same = [name for child in untouched for _, name in merged.below(child)]
            branch.add(line(f"{_count(len(same), 'limb')} without change: {_some(same)}", _QUIET))
        pending += [(branch, child) for child in reversed(children) if child not in untouched]
    loose = [change for change in merged.changes.get(None, []) if change.subject != "robot"]
    if loose:
        tree.add(Text("\n").join([Text("of no single limb", style=_QUIET), *_lines(loose)]))
    return tree


def _limb(name: str, changes: Sequence[Change], comparison: Comparison) -> Text:
    fate = next((change.kind for change in changes if change.subject == "limb" and change.kind in _SIGNS), None)
    if fate is not None:
        sign, style = _SIGNS[fate]
        facts = (comparison.second if fate == "added" else comparison.first).limbs[name]
        text = assembled((f"{sign} {name}", f"{_BOLD} {style}"), (f"  {_contents(changes)}", style))
        return text.append(f"; {facts['mass']:.4g} kg", style=style) if facts.get("mass") else text
    if not changes:
        return line(f"  {name}", _QUIET)
    new_name = next((c.new_name for c in changes if c.subject == "limb" and c.kind == "renamed"), None)
    title = assembled((f"~ {name}", f"{_BOLD} {_CHANGED}"))
    if new_name is not None:
        title.append_text(line(f" -> {new_name}", f"{_BOLD} {_CHANGED}"))
    rest = [change for change in changes if not (change.subject == "limb" and change.kind == "renamed")]
    return Text("\n").join([title, *_lines(rest)])


def _contents(changes: Sequence[Change]) -> str:
    """`hinge ffoot; actuator ffoot; 19 sensor tokens, 1 actuator token` of a limb that came or went."""
    names = [
        f"{subject} {', '.join(change.name for change in changes if change.subject == subject)}"
        for subject in ("joint", "actuator")
        if any(change.subject == subject for change in changes)
    ]
    numbers: Counter[str] = Counter(change.subject for change in changes)
    tokens = [_count(numbers[subject], subject) for subject in _TOKENS if numbers[subject]]
    return "; ".join([*names, ", ".join(tokens)])


def _lines(changes: Sequence[Change]) -> list[Text]:
    lines = []
    said = {(change.fact, change.before, change.after) for change in changes if change.subject == "actuator"}
    for change in changes:
        token = "token" in change.subject
        if change.kind == "changed":
            if change.subject != "actuator token" or (change.fact, change.before, change.after) not in said:
                lines.append(_changed(change))
        elif change.kind in _SIGNS and not token:
            sign, style = _SIGNS[change.kind]
            lines.append(line(f"{sign} {change.subject} {change.name}", style))
        elif change.kind == "renamed" and not token:
            lines.append(line(f"~ {change.subject} {change.name} -> {change.new_name}", _CHANGED))
    for subject in _TOKENS:
        lines += _token_lines([change for change in changes if change.subject == subject])
    order = Counter(change.subject for change in changes if change.kind == "reordered")
    if order:
        what = ", ".join(_count(number, subject) for subject, number in order.items())
        lines.append(line(f"~ elsewhere in the order: {what}", _CHANGED))
    return lines


def _token_lines(changes: Sequence[Change]) -> Iterable[Text]:
    for kind, word in (("removed", "gone: "), ("added", "new: "), ("renamed", "renamed: ")):
        some = [change for change in changes if change.kind == kind]
        if some:
            sign, style = _SIGNS.get(kind, ("~", _CHANGED))
            new_name = f" -> {some[0].new_name}" if kind == "renamed" else ""
            more = f" and {len(some) - 1} more" if len(some) > 1 else ""
            yield line(f"{sign} {_count(len(some), some[0].subject)} {word}{some[0].name}{new_name}{more}", style)


def _changed(change: Change) -> Text:
    subject = f"{change.subject} {change.name} " if change.subject not in ("limb", "robot") else ""
    text = assembled((f"~ {subject}{change.fact} ", _CHANGED))
    if change.fact == "fixed to it":
        return text.append_text(_names(change.before, change.after))
    before, after = (_value(change, value) for value in (change.before, change.after))
    text.append_text(line(before, _GONE))
    text.append(" -> ")
    text.append_text(line(after, _NEW))
    one, other = change.before, change.after
    if isinstance(one, float) and isinstance(other, float) and one:
        text.append(f"  ({100 * (other - one) / abs(one):+.3g} %)", style=_QUIET)
    return text


def _names(before: Value, after: Value) -> Text:
    """What is no longer in a list of names, and what is new there."""
    lists = [value if isinstance(value, tuple) else () for value in (before, after)]
    text = Text()
    for sign, one, other in (("-", lists[0], lists[1]), ("+", lists[1], lists[0])):
        names = [str(name) for name in one if name not in other]
        if names:
            text.append(" " if text else "").append_text(line(f"{sign} {_some(names)}", _GONE if sign == "-" else _NEW))
    return text or Text("in another order", style=_CHANGED)


def _some(names: Sequence[str]) -> str:
    return ", ".join(names[:_NAMED]) + (f" and {len(names) - _NAMED} more" if len(names) > _NAMED else "")


def _value(change: Change, value: Value) -> str:
    if value is None or value == ():
        return {"range": "unlimited", "bounds": "unbounded"}.get(change.fact or "", "none")
    unit, factor = change.unit, 1.0
    if unit == "rad" and change.fact in _ANGLES:
        unit, factor = "°", 180 / math.pi
    suffix = unit if unit in ("", "°") else f" {unit}"
    suffix = "" if unit == "1" else suffix
    if isinstance(value, float):
        return f"{value:.5g}{suffix}"
    if isinstance(value, str):
        return value
    digits = 12 if change.fact == "inertia" else 6
    numbers = [f"{round(factor * item, digits) + 0.0:.5g}" if isinstance(item, float) else str(item) for item in value]
    if change.fact in ("range", "bounds", "force range"):
        return " to ".join(numbers) + suffix
    return (f"({', '.join(numbers)})" if len(numbers) > 1 else numbers[0]) + suffix


def _count(number: int, what: str) -> str:
    return f"{number} {what}{'' if number == 1 else 's'}"
