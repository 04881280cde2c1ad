"""What the expressions of a xacro file that nobody vouches for may say: arithmetic, names, calls, comprehensions."""

from __future__ import annotations

import ast

_ALLOWED = (
    *(ast.Expression, ast.Constant, ast.Name, ast.Attribute, ast.Subscript, ast.Slice, ast.Starred, ast.Call),
    *(ast.keyword, ast.BoolOp, ast.BinOp, ast.UnaryOp, ast.Compare, ast.IfExp, ast.JoinedStr, ast.FormattedValue),
    *(ast.List, ast.Tuple, ast.Set, ast.Dict, ast.ListComp, ast.SetComp, ast.DictComp, ast.comprehension),
    *(ast.boolop, ast.operator, ast.unaryop, ast.cmpop, ast.expr_context),
)
# Ways from a value to the interpreter that need no underscore; `format` reads attributes that its text names.
_WAYS_OUT = frozenset({"format", "format_map", "mro", "gi_frame", "cr_frame", "ag_frame", "tb_frame", "f_back"})


class RefusedError(ValueError):
    """Something that only a file that is trusted may do."""


def check_expression(text: str) -> None:
    """Refuse what could lead out of an expression into the interpreter.

    Raises:
        RefusedError: It has a function of its own, a generator, an assignment, or an attribute or name that Python
            keeps for itself, at whatever depth.
        SyntaxError: It is no expression.
    """
    for node in ast.walk(ast.parse(text.strip(), "<expression>", "eval")):
        if not isinstance(node, _ALLOWED):
            raise RefusedError(f"{type(node).__name__.lower()} in the expression {text!r}")
        if isinstance(node, ast.Attribute) and (node.attr.startswith("_") or node.attr in _WAYS_OUT):
            raise RefusedError(f"attribute {node.attr!r} in the expression {text!r}")
        if isinstance(node, ast.Name) and node.id.startswith("__"):
            raise RefusedError(f"name {node.id!r} in the expression {text!r}")
