"""Fetching a scene on the terminal: the licence asked, the progress shown, one line for what fails."""

from __future__ import annotations

import sys

from rich.console import Console

from harness.errors import DefrayError, known
from harness.inputs.fetch.archives import archives
from harness.inputs.fetch.download import Progress, Unreachable
from harness.inputs.fetch.fetched import Ask, fetch
from scenes import recipes


def run_fetch(name: str, yes: bool) -> int:
    """Fetch one scene, or `all` that an archive is known of; returns the exit code, 1 where any was not fetched.

    Raises DefrayError where the only scene asked for was not fetched, and where there is no network.
    """
    if name != "all" and name not in recipes():
        raise known("scene", name, [*recipes(), "all"])
    names = [one for one in recipes() if one in archives()] if name == "all" else [name]
    console, failed = Console(stderr=True), 0

    def say(line: str) -> None:
        console.print(line, highlight=False, soft_wrap=True, markup=False)

    for one in names:
        status = console.status("")
        try:
            fetch(recipes()[one], Ask(say, lambda question: yes or _answer(question), _shown(one, status)))
        except Unreachable as error:
            raise DefrayError(f"{error}; without it the stand-ins will be used") from None
        except DefrayError as error:
            if len(names) == 1:
                raise
            say(f"error: {one}: {error}")
            failed += 1
        finally:
            status.stop()
    return 1 if failed else 0


def _answer(question: str) -> bool:
    """Ask on the terminal; without one nobody can accept a licence."""
    if not sys.stdin.isatty():
        raise DefrayError("the licence must be accepted: answer in a terminal, or pass --yes")
    return input(f"{question} [y/N] ").strip().lower() in ("y", "yes")


def _shown(name: str, status) -> Progress:
    """Progress as a status line, which starts with the first step."""

    def show(done: int, total: int | None) -> None:
        text = f"{done / 1e6:.0f} of {total / 1e6:.0f} MB" if total else f"file {done}"
        status.update(f"{name}: {text}")
        status.start()

    return show
