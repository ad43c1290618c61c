"""The documents: their links lead somewhere, their commands exist, the files that they name are there."""

from __future__ import annotations

import ast
import importlib.util
import re
import shlex
from pathlib import Path

import pytest
from typer.core import TyperGroup

from harness.commands.main import UsageError, commands, load

ROOT = Path(__file__).resolve().parents[1]
DOCUMENTS = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
FENCE = re.compile(r"^```(\w*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
FOLDERS = ("docs", "harness", "kernels", "results", "scenes", "scripts", "tests")
MOST_WORDS = 900  # of the README


def text_of(document: Path) -> str:
    """Its text with the contents of fences taken out."""
    return FENCE.sub("", document.read_text(encoding="utf-8"))


def fences(document: Path, language: str) -> list[str]:
    """Contents of the fences of one language."""
    return [body for found, body in FENCE.findall(document.read_text(encoding="utf-8")) if found == language]


def anchors(document: Path) -> set[str]:
    """What `#...` may name: headings in lower case, without punctuation, with hyphens for spaces."""
    headings = re.findall(r"^#+ (.+)$", text_of(document), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


def links() -> list[tuple[str, str]]:
    """Document and target of every link and picture that leads to no other site."""
    found = [(document, to) for document in DOCUMENTS for to in re.findall(r"\]\(([^)\s]+)\)", text_of(document))]
    return [(document.name, to) for document, to in found if "://" not in to]


def command_lines() -> list[tuple[str, bool]]:
    """Every `defray ...`, and whether it is whole: one in running text may leave out what a command requires."""
    found = {}
    for document in DOCUMENTS:
        for line in "\n".join(fences(document, "")).splitlines():
            for part in line.split("#")[0].split("&&"):
                words = re.sub(r"^\s*(?:\w+=\S+\s+)*", "", part).strip()
                if re.match(r"(\.venv/bin/)?defray ", words):
                    found[words] = True
        for span in re.findall(r"`([^`]+)`", text_of(document)):
            words = " ".join(span.split())
            if re.match(r"defray [a-z]", words):
                found.setdefault(words, False)
    return list(found.items())


def paths() -> list[tuple[str, str]]:
    """Document and path of every file and folder that a document names from the root of the checkout."""
    spans = [(document, span) for document in DOCUMENTS for span in re.findall(r"`([^`\s]+)`", text_of(document))]
    return sorted(
        {(document.name, span) for document, span in spans if re.match(rf"({'|'.join(FOLDERS)})/[\w./-]*$", span)}
    )


def example_imports() -> list[tuple[str, str, str]]:
    """Document, module and name of every import from the project in the Python examples."""
    found = []
    for document in DOCUMENTS:
        for body in fences(document, "python"):
            nodes = [node for node in ast.walk(ast.parse(body)) if isinstance(node, ast.ImportFrom)]
            found += [(document.name, node.module, alias.name) for node in nodes for alias in node.names]
    return [one for one in found if one[1].split(".")[0] in ("harness", "scenes")]


def parse(words: list[str], whole: bool) -> None:
    """Parse a command line as the command would, without running it."""
    name, *rest = words
    assert name in commands(), f"no command '{name}'"
    command = load(name)
    while True:
        try:
            context = command.make_context(name, list(rest))
        except UsageError as error:
            if whole or type(error).__name__ != "MissingParameter":
                raise
            return
        rest = context.args
        if not isinstance(command, TyperGroup) or not rest:
            return
        name, command, rest = command.resolve_command(context, [*context._protected_args, *rest])


@pytest.mark.parametrize(("name", "target"), links())
def test_links_lead_somewhere(name, target):
    document = next(one for one in DOCUMENTS if one.name == name)
    path, _, anchor = target.partition("#")
    there = (document.parent / path).resolve() if path else document
    assert there.exists(), f"{name}: {target}"
    assert not anchor or anchor in anchors(there), f"{name}: {target} names no heading"


@pytest.mark.parametrize(("line", "whole"), command_lines())
def test_commands_parse(line, whole):
    parse(shlex.split(line)[1:], whole)


@pytest.mark.parametrize("line", ["trace sponza --leaf 8", "trace", "scenes bring sponza", "scenes fetch --no crown"])
def test_a_wrong_command_is_caught(line):
    with pytest.raises(UsageError):
        parse(shlex.split(line), whole=True)


@pytest.mark.parametrize(("name", "path"), paths())
def test_files_named_are_there(name, path):
    made = ("results/out", "results/mine", "results/yours", "results/ours", "results/full")
    assert path.startswith(made) or (ROOT / path).exists(), f"{name} names {path}"


@pytest.mark.parametrize(("name", "module", "what"), example_imports())
def test_examples_import_what_is_there(name, module, what):
    there = importlib.util.find_spec(module) is not None and hasattr(importlib.import_module(module), what)
    assert there, f"{name}: {module} has no {what}"


def test_readme_is_short():
    words = len((ROOT / "README.md").read_text(encoding="utf-8").split())
    assert words <= MOST_WORDS, f"README.md has {words} words"
