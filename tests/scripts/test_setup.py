"""Set-up files: pinned with hashes, naming no registry, scripts that parse, targets that exist."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
REQUIREMENTS = sorted([ROOT / "requirements.txt", *ROOT.glob("scripts/runtimes/*.txt")])
SCRIPTS = [*sorted(ROOT.glob("scripts/**/*.sh")), ROOT / ".ci/run"]
TARGETS = ["setup", "second-device", "reproduce", "carry", "test", "test-all", "bench", "lint", "figures", "clean"]
# Spelt in pieces, so that this file does not name what it forbids.
REGISTRY_HOSTS = re.compile(
    "|".join(re.escape(name + end) for name, end in [
        ("pypi", ".org"), ("pythonhosted", ".org"), ("deb.debian", ".org"), ("security.debian", ".org"),
        ("snapshot.debian", ".org"), ("crates", ".io"), ("registry.npmjs", ".org"), ("repo.maven", ".apache"),
        ("proxy.golang", ".org"), ("conda", ".anaconda.org"), ("pkg", ".dev/"),
    ])
)  # fmt: skip
OPTIONS_NAMING_HOSTS = re.compile(r"^\s*(-i|-f|--(extra-)?index-url|--find-links|--trusted-host)\b", re.M)


def tracked_files() -> list[Path]:
    """Every text file that git knows."""
    if not (ROOT / ".git").exists() or not shutil.which("git"):
        pytest.skip("not a git checkout, or no git")
    listing = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=True)
    files = [ROOT / name for name in listing.stdout.split("\0") if name]
    return [file for file in files if file.is_file() and b"\0" not in file.read_bytes()[:1024]]


def test_no_tracked_file_names_a_registry():
    named = {}
    for file in tracked_files():
        found = REGISTRY_HOSTS.search(file.read_text(errors="replace"))
        if found:
            named[str(file.relative_to(ROOT))] = found.group()
    assert not named


@pytest.mark.parametrize("file", REQUIREMENTS, ids=lambda file: file.name)
def test_every_requirement_is_pinned_with_hashes(file):
    text = file.read_text()
    assert not OPTIONS_NAMING_HOSTS.search(text)
    entries = [entry for entry in re.split(r"\n(?=[a-z])", text) if re.match(r"[a-z]", entry)]
    assert entries
    for entry in entries:
        assert re.match(r"[a-z][\w.-]*==[\w.+]+ \\\n", entry), entry.splitlines()[0]
        assert "--hash=sha256:" in entry, entry.splitlines()[0]


def test_every_named_requirement_is_locked():
    for names in [ROOT / "requirements.in", *ROOT.glob("scripts/runtimes/*.in")]:
        locked = set(re.findall(r"^([a-z][\w.-]*)==", names.with_suffix(".txt").read_text(), re.M))
        wanted = {line for line in names.read_text().split("\n") if line and not line.startswith("#")}
        assert wanted <= locked


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda script: script.name)
def test_scripts_parse(script):
    subprocess.run(["bash", "-n", str(script)], check=True)


def test_make_help_lists_every_target():
    text = subprocess.run(["make", "help"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    listed = {line.split()[0] for line in text.splitlines() if line.startswith("  ")}
    assert set(TARGETS) <= listed


def copy_of_setup(folder: Path) -> Path:
    """A checkout with the set-up files only, its .venv a fake that looks finished."""
    for name in ["requirements.txt", "pyproject.toml", "scripts/setup.sh"]:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / name, folder / name)
    shutil.copytree(ROOT / "scripts/runtimes", folder / "scripts/runtimes")
    python = folder / ".venv/bin/python"
    python.parent.mkdir(parents=True)
    python.write_text("#!/bin/sh\necho called >> called\nexit 1\n")
    python.chmod(0o755)
    vendors = folder / ".venv/etc/defray/opencl-vendors"
    vendors.mkdir(parents=True)
    (vendors / "some.icd").write_text("libsome.so\n")
    parts = ["requirements.txt", "pyproject.toml", "scripts/setup.sh", "scripts/runtimes/*.txt"]
    stamp = f"cat {' '.join(parts)} | sha256sum > .venv/defray-stamp"
    subprocess.run(["bash", "-c", stamp], cwd=folder, check=True)
    return folder


def set_up(folder: Path, *arguments: str) -> subprocess.CompletedProcess:
    """Run set-up where no Python can be found, so that it cannot go far."""
    command = ["bash", "scripts/setup.sh", *arguments]
    tools = folder / "tools"
    tools.mkdir(exist_ok=True)
    for name in ["bash", "cat", "dirname", "flock", "sha256sum", "id", "rm", "tail"]:
        found = shutil.which(name)
        if found and not (tools / name).exists():
            (tools / name).symlink_to(found)
    environment = {"PATH": str(tools), "DEFRAY_SETUP_APT": "0"}
    return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)


def test_setup_does_nothing_twice(tmp_path):
    folder = copy_of_setup(tmp_path)
    done = set_up(folder)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    assert not (folder / "called").exists()


@pytest.mark.parametrize("changed", ["requirements.txt", "pyproject.toml", "scripts/runtimes/intel.txt"])
def test_setup_starts_again_when_an_input_changes(tmp_path, changed):
    folder = copy_of_setup(tmp_path)
    with (folder / changed).open("a") as file:
        file.write("# changed\n")
    done = set_up(folder)
    assert done.returncode == 1
    assert "apt-get install python3.11" in done.stderr  # it went on, and says what to install


def test_setup_refuses_an_unknown_argument(tmp_path):
    done = set_up(copy_of_setup(tmp_path), "--with-everything")
    assert done.returncode == 1
    assert "--with-everything" in done.stderr
