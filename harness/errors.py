"""The one error type that reaches a user: a single clear line and a non-zero exit."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pydantic import ValidationError


class DefrayError(Exception):
    """Bad input or a missing device; `str(error)` is one line saying what is wrong and what to do."""

    exit_code = 2

    def __str__(self) -> str:
        # A path or a library's message may bring line breaks of its own.
        return " ".join(super().__str__().split())


class CheckFailed(DefrayError):
    """Hits that a check found wrong."""

    exit_code = 1


def known(kind: str, name: str, names) -> DefrayError:
    """Error for an unknown `name` that lists the known ones."""
    return DefrayError(f"unknown {kind} '{name}'; known: {', '.join(sorted(names)) or 'none'}")


def first_problem(error: ValidationError) -> str:
    """The first problem of a failed validation on one line, as `field.name: what is wrong`."""
    problem = error.errors()[0]
    field = ".".join(str(part) for part in problem["loc"])
    message = problem["msg"].removeprefix("Value error, ")
    message = {
        "Extra inputs are not permitted": "unknown key",
        "Unexpected keyword argument": "unknown key",
        "Field required": "missing key",
    }.get(message, message[:1].lower() + message[1:])
    others = f" (and {error.error_count() - 1} more)" if error.error_count() > 1 else ""
    return (f"{field}: {message}" if field else message) + others
