"""What is known of every tracer without running it: stated in the tracers' own files, which are read, not imported.

A tracer is one file `tracers/NAME.py` (or a folder with a file `tracer.py`) that ends in `TRACER = TheClass` and may
end in `FACTS = TracerFacts(...)`, all of it literals. Figures and the cost model ask here, so that
drawing needs no OpenCL.
"""

from __future__ import annotations

import ast
import functools
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, ValidationError

from harness.errors import DefrayError, first_problem
from harness.files import extra_folders

Colour = Literal["blue", "orange", "green", "red", "pink", "sky", "grey"]
Marker = Literal["o", "s", "D", "P", "X", "v", "^", "<", "p", "h", "*"]  # as matplotlib names them


class TracerFacts(BaseModel):
    """What figures and the cost model know of a tracer; each fact may be left out.

    `order`: its place among tracers, from 1; those without one come last, by name. `colour`, `marker`: in figures.
    `kernels`: its own kernels in the order of their first launch, and what figures call each; `test_kernels`: those
    of them that test triangles.

    `terms`: of the cost model, by stage, each a field of RayWork; `rest` is what no other stage covers.
    `fast_options`: what the cost model is fitted with and `auto` chooses besides; `fitted_options`: what is added to
    them, a run each; `fitted_rays`: of such a run.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    order: int | None = None
    colour: Colour | None = None
    marker: Marker | None = None
    kernels: dict[str, str] = {}
    test_kernels: tuple[str, ...] = ()
    terms: dict[str, tuple[str, ...]] = {"rest": ("one", "steps", "pairs", "tests")}
    fast_options: dict[str, str] = {}
    fitted_options: tuple[dict[str, str], ...] = ({},)
    fitted_rays: int = 1 << 16


@dataclass(frozen=True)
class ListedTracer:
    """A tracer as its file states it.

    `defaults`: of the options that its own Options class adds, as text.
    """

    name: str
    file: Path
    facts: TracerFacts
    defaults: dict[str, str]


def listed_tracers() -> dict[str, ListedTracer]:
    """Every tracer by name, in order. Raises DefrayError for a file that cannot be read, or two of one name."""
    return _listed(tuple(extra_folders("tracers")))


def tracer_facts(name: str) -> TracerFacts:
    """The facts of a tracer; of one that no file states, those that hold where nothing is stated."""
    listed = listed_tracers().get(name)
    return listed.facts if listed else TracerFacts()


def tracer_place(name: str) -> int:
    """The place of a tracer among all, from 0; of one that no file states, after the last."""
    names = list(listed_tracers())
    return names.index(name) if name in names else len(names)


@functools.cache
def _listed(folders: Sequence[Path]) -> dict[str, ListedTracer]:
    found: dict[str, ListedTracer] = {}
    for folder in folders:
        for file in sorted([*folder.glob("*.py"), *folder.glob("*/tracer.py")]):
            tracer = read_tracer(file)
            if tracer is None:
                continue
            if tracer.name in found:
                raise DefrayError(f"{file}: tracer '{tracer.name}' is in {found[tracer.name].file} too; rename it")
            found[tracer.name] = tracer
    last = 1 + max((one.facts.order or 0 for one in found.values()), default=0)
    return dict(sorted(found.items(), key=lambda item: (item[1].facts.order or last, item[0])))


def read_tracer(file: Path) -> ListedTracer | None:
    """The tracer that a file states, without running any of it; None for a file without one.

    Raises DefrayError for a file that is not Python, or whose statements are not literals.
    """
    try:
        tree = ast.parse(file.read_text(encoding="utf-8"))
    except (SyntaxError, UnicodeDecodeError, OSError) as error:
        raise DefrayError(f"cannot read {file}: {error}") from None
    stated = _assigned(tree)
    if "TRACER" not in stated:
        return None
    classes = {node.name: _assigned(node) for node in tree.body if isinstance(node, ast.ClassDef)}
    tracer = classes.get(getattr(stated["TRACER"], "id", ""))
    name = _literal(tracer["name"]) if tracer and "name" in tracer else None
    if not isinstance(name, str):
        raise DefrayError(f"{file}: TRACER must be a class of this file with a name = '...'")
    options = classes.get(getattr(tracer.get("Options"), "id", ""), {})
    defaults = {option: _default(value) for option, value in options.items()}
    return ListedTracer(
        name=name,
        file=file,
        facts=_read_facts(file, stated["FACTS"]) if "FACTS" in stated else TracerFacts(),
        defaults={option: _as_text(value) for option, value in defaults.items() if value is not None},
    )


def _read_facts(file: Path, node: ast.expr) -> TracerFacts:
    values = {word.arg: _literal(word.value) for word in getattr(node, "keywords", [])}
    if not isinstance(node, ast.Call) or node.args or None in values or None in values.values():
        raise DefrayError(f"{file}: FACTS must be TracerFacts(...) of literals by name")
    try:
        return TracerFacts(**values)
    except ValidationError as error:
        raise DefrayError(f"{file}: FACTS: {first_problem(error)}") from None


def _assigned(body: ast.Module | ast.ClassDef) -> dict[str, ast.expr]:
    """Names that a module or class assigns directly, and what."""
    found = {}
    for node in body.body:
        if isinstance(node, ast.Assign) and len(node.targets) == 1 and isinstance(node.targets[0], ast.Name):
            found[node.targets[0].id] = node.value
        elif isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name) and node.value is not None:
            found[node.target.id] = node.value
    return found


def _literal(node: ast.expr) -> Any:
    """The value of a literal; None for anything else."""
    try:
        return ast.literal_eval(node)
    except ValueError:
        return None


def _default(node: ast.expr) -> Any:
    """The default that an option states, as a literal or in a Field; None where it is neither."""
    if isinstance(node, ast.Call):
        return next((_literal(word.value) for word in node.keywords if word.arg == "default"), None)
    return _literal(node)


def _as_text(value: Any) -> str:
    """An option's value as variants write it."""
    return str(value).lower() if isinstance(value, bool) else str(value)
