"""Whether a claim's rule stood in the repository, as it is now, when the records it judges were measured."""

from __future__ import annotations

import subprocess
import tomllib
from functools import lru_cache
from pathlib import Path

from harness.files import ROOT

FILE = "harness/paper/claims.toml"


@lru_cache(maxsize=64)
def rules_at(commit: str, root: Path = ROOT) -> dict[str, list] | None:
    """The rules of every claim at a commit, by id; empty where it had none, None where the commit is unknown."""
    if not commit or _git(root, "cat-file", "-e", f"{commit}^{{commit}}") is None:
        return None
    text = _git(root, "show", f"{commit}:{FILE}")
    if text is None:
        return {}
    try:
        claims = tomllib.loads(text).get("claim", [])
    except tomllib.TOMLDecodeError:
        return {}
    return {claim.get("id", ""): claim.get("rule", []) for claim in claims}


@lru_cache(maxsize=4)
def rules_now(path: Path = ROOT / FILE) -> dict[str, list]:
    """The rules of every claim as they stand in the working tree, by id."""
    return {claim["id"]: claim["rule"] for claim in tomllib.loads(path.read_text(encoding="utf-8"))["claim"]}


def rule_before_run(claim: str, commits: set[str], path: Path = ROOT / FILE, root: Path = ROOT) -> bool | None:
    """Whether every one of these commits had the claim's rule of today; None where that cannot be told."""
    then = [rules_at(commit, root) for commit in sorted(commits)]
    if not then or any(rules is None for rules in then):
        return None
    now = rules_now(path).get(claim)
    return all(rules.get(claim) == now for rules in then)


def _git(root: Path, *arguments: str) -> str | None:
    """Output of a git command; None where it fails or there is no git."""
    try:
        done = subprocess.run(
            ["git", "-C", str(root), *arguments], capture_output=True, text=True, timeout=20, check=False
        )
    except (OSError, subprocess.TimeoutExpired):
        return None
    return done.stdout if done.returncode == 0 else None
