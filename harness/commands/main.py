"""The `defray` command: a table of the commands of this folder, each imported when it is called.

A command is one file `commands/NAME.py`: its docstring begins with "`defray NAME`: what it does.", and it has a
function NAME with Typer's annotations (or a Typer app called `app`), and maybe `EPILOG`, examples for its help.
"""

from __future__ import annotations

import ast
import importlib
import os
import sys
from pathlib import Path

import typer
from typer.core import TyperCommand, TyperGroup

from harness.commands.options import print_error
from harness.errors import DefrayError

# In the order of first use; whatever else lies in the folder follows by name.
ORDER = (
    "doctor",
    "scenes",
    "trace",
    "compare",
    "recommend",
    "sweep",
    "accuracy",
    "stability",
    "coherence",
    "roofline",
    "reproduce",
    "views",
    "report",
    "claims",
    "merge",
)
HELP = (
    "Benchmark deferred ray tracing: rays are binned by the cells they visit, then bins are intersected one after "
    "the other. Every result is checked against an independent ray tracer; a run that fails its check has no "
    "rate.\n\n"
    "Start with [bold]defray doctor[/bold] (does OpenCL work here?), then "
    "[bold]defray trace sponza --rays 64k[/bold]."
)


def commands() -> dict[str, str]:
    """Every command's name and what it does, from the first lines of the files, without importing them."""
    found = {}
    for file in sorted(Path(__file__).parent.glob("*.py")):
        first = (ast.get_docstring(ast.parse(file.read_text(encoding="utf-8"))) or "").splitlines()[0:1]
        head, _, about = "".join(first).partition(": ")
        if head == f"`defray {file.stem}`":
            found[file.stem] = about[:1].upper() + about[1:]
    place = {name: number for number, name in enumerate(ORDER)}
    return dict(sorted(found.items(), key=lambda item: (place.get(item[0], len(ORDER)), item[0])))


def load(name: str) -> TyperCommand:
    """The command, its file imported."""
    module = importlib.import_module(f"harness.commands.{name}")
    if hasattr(module, "app"):
        made = typer.main.get_command(module.app)
        made.name = name
        return made
    app = typer.Typer(add_completion=False, pretty_exceptions_enable=False, rich_markup_mode="rich")
    app.command(name, epilog=getattr(module, "EPILOG", None))(getattr(module, name))
    return typer.main.get_command(app)


class LazyCommands(TyperGroup):
    """The commands of this folder: one is imported when it is called, none for the list of them."""

    def list_commands(self, ctx: typer.Context) -> list[str]:
        """Names, in the order of the help."""
        return list(commands())

    def get_command(self, ctx: typer.Context, name: str) -> TyperCommand | None:
        """What the list shows of a command; `resolve_command` brings the command itself."""
        about = commands().get(name)
        return None if about is None else TyperCommand(name, help=about, rich_markup_mode="rich")

    def resolve_command(self, ctx: typer.Context, args: list[str]):
        """The command that is called, imported now."""
        name, _, rest = super().resolve_command(ctx, args)
        return name, load(name), rest


UsageError = typer.BadParameter.__base__  # Typer names no other way to it
app = typer.Typer(
    name="defray", cls=LazyCommands, no_args_is_help=True, add_completion=False, pretty_exceptions_enable=False,
    rich_markup_mode="rich", help=HELP,
)  # fmt: skip


@app.callback()
def defray() -> None:
    """Nothing beside the commands."""


defray.__doc__ = HELP


def main() -> None:
    """Entry point of `defray`: errors become one line on standard error and a non-zero exit code."""
    try:
        sys.exit(app(prog_name="defray", standalone_mode=False))
    except DefrayError as error:
        print_error(str(error))
        sys.exit(error.exit_code)
    except UsageError as error:
        where = error.ctx.command_path if error.ctx else "defray"
        print_error(f"{error.format_message()} ('{where} --help' explains)")
        sys.exit(2)
    except (KeyboardInterrupt, typer.Abort):
        sys.exit(130)
    except MemoryError:
        print_error("not enough memory; take fewer rays, a smaller scene or a coarser grid")
        sys.exit(2)
    except Exception as error:
        if os.environ.get("DEFRAY_TRACEBACK"):
            raise
        text = " ".join(f"{type(error).__name__}: {error}".split())[:300]
        if isinstance(error, OSError) and error.filename:
            print_error(f"cannot use {error.filename}: {error.strerror}")
        else:
            print_error(f"{text} (a fault in defray; DEFRAY_TRACEBACK=1 shows where)")
        sys.exit(2)


if __name__ == "__main__":
    main()
