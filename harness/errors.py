"""The one error type that reaches a user: a single clear line and a non-zero exit."""


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
    return DefrayError(f"unknown {kind} '{name}'; known: {', '.join(sorted(names))}")
