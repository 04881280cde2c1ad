"""The `morphkit` command: the Typer app and the one place where errors become messages and exit codes.

Nothing heavy is imported here: every command imports what it needs when it runs.
"""

from __future__ import annotations

import io
import os
import sys
from collections.abc import Callable, Sequence
from typing import Annotated

import typer

from morphkit.errors import MorphkitError, TrainingError

from . import (
    ablate,
    benchmark,
    benchmark_random,
    benchmark_run,
    check,
    common,
    convert,
    coverage,
    diff,
    evaluate,
    export,
    push,
    robots,
    show,
    tokens,
    train,
    zoo,
)
from .terminal import guard_warnings, note
from .termination import Termination

INTERRUPTED = 130
TERMINATED = 143

app = typer.Typer(
    name="morphkit",
    no_args_is_help=True,
    rich_markup_mode="rich",
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
    epilog="""A ROBOT is the name of a robot that ships with morphkit (see 'morphkit robots') or a URDF or MJCF file.
'morphkit COMMAND --help' explains a command and gives examples.""",
)


def _print_version(wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version

        print(f"morphkit {version('morphkit')}")
        raise typer.Exit


@app.callback()
def morphkit(
    version: Annotated[
        bool, typer.Option("--version", help="Print the version and exit.", callback=_print_version, is_eager=True)
    ] = False,
) -> None:
    """From a robot file to one policy that controls every body you can cut out of it."""


def _register(name: str, command: Callable[..., None], examples: Sequence[str], to: typer.Typer = app) -> None:
    """Add a command whose help is its docstring, unwrapped so that it fills any terminal, and its examples."""
    paragraphs = [" ".join(part.split()) for part in (command.__doc__ or "").split("\n\n")]
    epilog = "\n".join(["Examples:", *(f"  {example}" for example in examples)])
    to.command(name, help="\n\n".join(paragraphs), short_help=paragraphs[0], epilog=epilog)(command)


_register("robots", robots.robots, robots.EXAMPLES)
_register("tokens", tokens.tokens, tokens.EXAMPLES)
_register("ablate", ablate.ablate, ablate.EXAMPLES)
_register("check", check.check, check.EXAMPLES)
_register("convert", convert.convert, convert.EXAMPLES)
_register("diff", diff.diff, diff.EXAMPLES)
_register("show", show.show, show.EXAMPLES)
_register("train", train.train, train.EXAMPLES)
_register("evaluate", evaluate.evaluate, evaluate.EXAMPLES)
_register("coverage", coverage.coverage, coverage.EXAMPLES)
_register("export", export.export, export.EXAMPLES)
_register("push", push.push, push.EXAMPLES)
_register("zoo", zoo.zoo, zoo.EXAMPLES)

_benchmark = typer.Typer(no_args_is_help=True, rich_markup_mode="rich")
app.add_typer(_benchmark, name="benchmark", help="The modular-rl benchmark: 32 bodies, 8 tasks, 3 splits.")
_register("robots", benchmark.robots, benchmark.ROBOTS_EXAMPLES, to=_benchmark)
_register("random", benchmark_random.random, benchmark_random.EXAMPLES, to=_benchmark)
_register("run", benchmark_run.run, benchmark_run.EXAMPLES, to=_benchmark)
_register("status", benchmark.status, benchmark.STATUS_EXAMPLES, to=_benchmark)
_register("report", benchmark.report, benchmark.REPORT_EXAMPLES, to=_benchmark)


def _usage_error(error: Exception) -> int:
    """Report what Typer found wrong with the arguments; anything else is raised again."""
    describe = getattr(error, "format_message", None)
    if describe is None:
        raise error
    # Typer hands on the words of its validator, which name Python's exception.
    common.complain(describe().replace("Value error, ", ""))
    context = getattr(error, "ctx", None)
    command = context.command_path if context is not None else "morphkit"
    note(f"Try '{command} --help'.")
    return int(getattr(error, "exit_code", 2))


def _with_values(words: Sequence[str]) -> list[str]:
    """Arguments in which `--ray` has its value: `local` where no address follows."""
    pairs = zip(words, [*words[1:], "-"], strict=False)
    return [f"{word}=local" if word == "--ray" and after.startswith("-") else word for word, after in pairs]


def _drop_stdout() -> None:
    """Point stdout at nothing, so that what is still buffered raises no second error at exit."""
    sink = os.open(os.devnull, os.O_WRONLY)
    os.dup2(sink, sys.stdout.fileno())
    os.close(sink)


def run(arguments: Sequence[str] | None = None) -> int:
    """Run the command line.

    Args:
        arguments: The words after `morphkit`; None for those of the process.

    Returns:
        Exit code: 0 fine, 1 findings or a failed run, 2 wrong usage or bad input, 130 interrupted,
        143 terminated.
    """
    # PyTorch's threads would spin for a millisecond while they wait, and starve where other processes want the cores.
    os.environ.setdefault("GOMP_SPINCOUNT", "1000")
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="replace")  # what a Latin-1 terminal lacks, and file names that are no text
    guard_warnings()
    with Termination() as termination:
        code = _run(arguments)
    if code == INTERRUPTED:
        note("terminated" if termination.came else "interrupted")
        return TERMINATED if termination.came else INTERRUPTED
    return code


def _run(arguments: Sequence[str] | None) -> int:
    """The exit code of a command; every error has become a message."""
    try:
        # Outside its standalone mode Typer returns the code of an Exit and leaves usage errors to us.
        code = app(args=_with_values(sys.argv[1:] if arguments is None else arguments), standalone_mode=False)
        sys.stdout.flush()
        return code if isinstance(code, int) else 0
    except (KeyboardInterrupt, typer.Abort):
        return INTERRUPTED
    except BrokenPipeError:
        _drop_stdout()
        return 0
    except MorphkitError as error:
        common.complain(str(error))
        return 1 if isinstance(error, TrainingError) else 2
    except OSError as error:
        _drop_stdout()
        where = f"{error.filename}: " if error.filename else ""
        common.complain(f"{where}{error.strerror or error}")
        return 2
    except UnicodeEncodeError as error:
        around = error.object[max(0, error.start - 60) : error.end + 20]
        common.complain(f"{ascii(around)[1:-1]}: is no UTF-8 text; choose another name")
        return 2
    except MemoryError as error:
        common.complain(f"not enough memory: {error}" if str(error) else "not enough memory")
        return 2
    except Exception as error:
        return _usage_error(error)


def main() -> None:
    """Entry point of the installed command."""
    sys.exit(run())


if __name__ == "__main__":
    main()
