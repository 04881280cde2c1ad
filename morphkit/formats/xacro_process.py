"""The process that expands one xacro file: `python -m morphkit.formats.xacro_process`.

It talks in lines of JSON: a request on stdin, its questions and at last the result on stdout; see `xacro_access`. A
file that is not trusted is expanded after this process has given up everything else that the system offers.
"""

from __future__ import annotations

import ast
import base64
import builtins
import io
import json
import os
from collections.abc import Iterable, Mapping
from errno import ENOENT
from typing import Any, TextIO

from morphkit.formats.xacro_expressions import RefusedError, check_expression
from morphkit.utils.confine import confine
from morphkit.utils.suggest import did_you_mean

_BUILTINS = (
    *("abs", "all", "any", "bool", "dict", "divmod", "enumerate", "filter", "float", "int", "len", "list", "map"),
    *("max", "min", "ord", "range", "repr", "reversed", "round", "set", "sorted", "str", "sum", "tuple", "zip"),
)


class _UnknownArgumentError(Exception):
    pass


class _Parent:
    """The process that asked for the expansion."""

    def __init__(self, questions: TextIO, answers: TextIO) -> None:
        self._questions, self._answers = questions, answers

    def request(self) -> dict[str, Any]:
        """What is to be done."""
        return dict(json.loads(self._answers.readline()))

    def ask(self, kind: str, value: str) -> dict[str, Any]:
        """Ask a question and wait for the answer; a refusal becomes a RefusedError."""
        self.tell({kind: value})
        answer = dict(json.loads(self._answers.readline()))
        if "refused" in answer:
            raise RefusedError(answer["refused"])
        if "problem" in answer:
            raise ValueError(answer["problem"])
        return answer

    def tell(self, message: Mapping[str, Any]) -> None:
        """Say something that needs no answer."""
        self._questions.write(json.dumps(message) + "\n")
        self._questions.flush()

    def find(self, name: str) -> str:
        """The folder of a package."""
        return str(self.ask("find", name)["path"])

    def open(self, name: str, *_: Any) -> io.BytesIO:
        """The content of a file as a stream."""
        answer = self.ask("open", name)
        if "missing" in answer:
            raise OSError(ENOENT, answer["missing"], name)
        return io.BytesIO(base64.b64decode(answer["content"]))

    def glob(self, pattern: str) -> list[str]:
        """The files that a pattern matches."""
        return list(self.ask("list", pattern)["names"])

    def variable(self, name: str) -> str:
        """The value of a variable of the environment, which it has not; a RefusedError where the user's has it."""
        if self.ask("environment", name)["set"]:
            raise RefusedError(f"the environment variable {name}")
        raise ValueError(f"environment variable {name!r} is not set")

    def optional_variable(self, name: str, default: str = "") -> str:
        """`default`, unless the user's environment has the variable: a RefusedError."""
        if self.ask("environment", name)["set"]:
            raise RefusedError(f"the environment variable {name}")
        return default


def _fence(parent: _Parent) -> None:
    """Replace all of the library's that reaches out of it."""
    import xacro
    from xacro import substitution_args

    evaluate = xacro.safe_eval

    def checked(text: str, names: dict[str, Any], local: Any = None) -> Any:
        check_expression(text)
        return evaluate(text, names, local)

    def extension(text: str, context: dict[str, Any]) -> str:
        check_expression(text)
        names = {node.id for node in ast.walk(ast.parse(text.strip(), mode="eval")) if isinstance(node, ast.Name)}
        for name in names & {*dir(builtins)} - {*_BUILTINS, *substitution_args._eval_dict, "True", "False", "None"}:
            raise RefusedError(f"{name!r} in the expression {text!r}")
        arguments = context.setdefault("arg", {})

        def argument(name: str) -> Any:
            return substitution_args.convert_value(substitution_args._eval_arg(name, arguments), "auto")

        known = substitution_args._DictWrapper(arguments, {**substitution_args._eval_dict, "arg": argument})
        permitted = {name: getattr(builtins, name) for name in _BUILTINS}
        return str(eval(compile(text.strip(), "<expression>", "eval"), {"__builtins__": permitted}, known))

    class _Glob:
        glob = staticmethod(parent.glob)

    xacro.safe_eval = checked
    xacro.open = parent.open  # the name that the module looks up before Python's own
    xacro.glob = _Glob
    for name in ("vars", "type"):  # ways to attributes by their names as texts
        dict.pop(xacro._global_symbols["python"], name, None)
    substitution_args._eval = extension
    substitution_args._eval_env = parent.variable
    substitution_args._eval_optenv = parent.optional_variable
    substitution_args._eval_dict |= {"env": parent.variable, "optenv": parent.optional_variable}


def _expand(file: str, arguments: Mapping[str, str], parent: _Parent) -> str:
    import xacro
    from xacro import substitution_args

    substitution_args._eval_find = parent.find
    substitution_args._eval_dict["find"] = parent.find
    parse = xacro.parse

    def parse_plain(source: object, filename: str | None = None) -> object:
        document = parse(source, filename)
        if document.doctype is not None:
            raise ValueError(f"{filename}: document type declarations are refused")
        for element in document.getElementsByTagName("xacro:arg"):
            known.setdefault(element.getAttribute("name"), element.getAttribute("default"))
        return document

    known: dict[str, str] = {}
    xacro.parse = parse_plain
    try:
        document = xacro.process_file(file, mappings=dict(arguments))
    except RefusedError:
        raise
    except Exception:
        _refuse_unknown(arguments, known)  # this explains more than what came of it
        raise
    _refuse_unknown(arguments, known)
    return str(document.toprettyxml(indent="  "))


def _refuse_unknown(arguments: Iterable[str], known: Mapping[str, str]) -> None:
    listed = ", ".join(f"{name} (default {default!r})" for name, default in known.items())
    for name in arguments:
        if name not in known:
            has = f"its arguments: {listed}" if listed else "it has none"
            raise _UnknownArgumentError(f"has no argument {name!r}{did_you_mean(name, known)} ({has})")


def _limit_resources(seconds: int, memory: int) -> None:
    import resource

    resource.setrlimit(resource.RLIMIT_AS, (memory, memory))
    resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds + 1))  # at the hard limit it would be SIGKILL
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def _result(request: Mapping[str, Any], parent: _Parent) -> dict[str, str]:
    try:
        return {"urdf": _expand(request["file"], request["arguments"], parent)}
    except MemoryError:
        return {"error": "it needs more memory than it may have"}
    except RecursionError:
        return {"error": "it calls itself without end"}
    except _UnknownArgumentError as error:
        return {"unknown": str(error)}
    except Exception as error:
        cause: BaseException = error
        while isinstance(inner := getattr(cause, "exc", None), BaseException):
            cause = inner
        kind = "refused" if isinstance(cause, RefusedError) else "error"
        return {kind: " ".join(str(cause).split()) or type(cause).__name__}


def main() -> None:
    """Expand what the request on stdin says."""
    own = os.dup(1)
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)  # what the library prints
    os.dup2(nowhere, 2)
    parent = _Parent(os.fdopen(own, "w", encoding="ascii"), os.fdopen(0, encoding="ascii", closefd=False))
    request = parent.request()
    if os.name == "posix":
        _limit_resources(request["seconds"], request["memory"])
    import xml.dom.expatbuilder  # noqa: F401 - nothing can be imported once the process is confined

    import xacro  # noqa: F401

    if not request["trusted"]:
        _fence(parent)
        confine()
    parent.tell(_result(request, parent))


if __name__ == "__main__":
    main()
