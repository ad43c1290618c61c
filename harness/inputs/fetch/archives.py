"""Archives of real scenes: what is known of them beforehand, and how members are taken out safely."""

from __future__ import annotations

import functools
import stat
import tarfile
import tomllib
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path, PurePosixPath

from pydantic import Field, ValidationError, model_validator

import scenes
from harness.data import Strict
from harness.errors import DefrayError, first_problem
from harness.inputs.fetch.download import check_room

LARGEST = 6 << 30  # bytes one archive may unpack to; San Miguel's OBJ has 1.1 GB
CHUNK = 1 << 20


class Archive(Strict, frozen=True):
    """One table of `scenes/archives.toml`, which explains the keys."""

    url: str = Field(pattern=r"^https?://")
    licence: str
    files: tuple[str, ...] = ()
    entry: str | None = None
    size: int | None = Field(default=None, gt=0)
    sha256: str | None = Field(default=None, pattern="^[0-9a-f]{64}$")
    triangles: int | None = Field(default=None, gt=0)
    up: str = "y"

    @model_validator(mode="after")
    def _one_way(self) -> Archive:
        if bool(self.files) == bool(self.entry):
            raise ValueError("give either files or entry")
        if self.entry and not self.url.endswith("/"):
            raise ValueError("the url of loose files must end in /")
        return self


@functools.cache
def archives() -> dict[str, Archive]:
    """Every archive by scene name."""
    path = Path(scenes.__file__).with_name("archives.toml")
    try:
        tables = tomllib.loads(path.read_text(encoding="utf-8"))
        return {name: Archive.model_validate(table) for name, table in tables.items()}
    except ValidationError as error:
        raise DefrayError(f"{path.name}: {first_problem(error)}") from None
    except (OSError, tomllib.TOMLDecodeError) as error:
        raise DefrayError(f"cannot read {path}: {error}") from None


def safe_path(name: str, what: str) -> PurePosixPath:
    """`name` as a path that stays inside its folder; raises DefrayError for one that would leave it."""
    path = PurePosixPath(name.replace("\\", "/"))
    if path.is_absolute() or ".." in path.parts or not path.parts or ":" in path.parts[0] or "\0" in name:
        raise DefrayError(f"{what} names '{name}', which leads out of its folder: refused")
    return path


def extract(archive: Path, wanted: tuple[str, ...], folder: Path, largest: int = LARGEST) -> list[Path]:
    """Take the `wanted` members of a zip or tar archive out into `folder`, in this order, and nothing else.

    A member may lie in any folder of the archive if its name is unique. Raises DefrayError for a damaged archive, a
    member that is missing or named twice, any name that leads out of the folder, a wanted member that is a link,
    and more than `largest` bytes in all, whatever the archive's headers say.
    """
    found, left = [], largest
    try:
        with _opened(archive) as members:
            for name in members:
                safe_path(name, archive.name)
            for number, name in enumerate(wanted):
                chosen = _member(archive, name, list(members))
                regular, size, read = members[chosen]
                if not regular:
                    raise DefrayError(f"{archive.name}: {chosen} is a link or no file: refused")
                if size > left:
                    raise DefrayError(f"{archive.name} unpacks to more than {largest / 1e9:.1f} GB: refused")
                check_room(folder, size, chosen)
                target = folder / f"{number}-{PurePosixPath(chosen).name}"
                left -= _write(read, target, left, archive.name)
                found.append(target)
    except (zipfile.BadZipFile, tarfile.TarError, zlib.error, EOFError, NotImplementedError, RuntimeError) as error:
        raise DefrayError(f"{archive.name} is damaged: {error}") from None
    return found


@contextmanager
def _opened(archive: Path) -> Iterator[dict]:
    """Members by name: whether it is a regular file, its size by the header, and a function that opens it."""
    if tarfile.is_tarfile(archive):
        with tarfile.open(archive) as tar:
            yield {one.name: (one.isreg(), one.size, functools.partial(tar.extractfile, one)) for one in tar}
        return
    with zipfile.ZipFile(archive) as packed:
        yield {
            one.filename: (_is_file(one), one.file_size, functools.partial(packed.open, one))
            for one in packed.infolist()
        }


def _is_file(one: zipfile.ZipInfo) -> bool:
    kind = stat.S_IFMT(one.external_attr >> 16)
    return not one.is_dir() and kind in (0, stat.S_IFREG)


def _member(archive: Path, name: str, names: list[str]) -> str:
    """The one member that `name` means."""
    if name in names:
        return name
    alike = [one for one in names if one.endswith(f"/{name}")]
    if len(alike) != 1:
        raise DefrayError(f"{archive.name} holds " + (f"{len(alike)} files named {name}" if alike else f"no {name}"))
    return alike[0]


def _write(read, target: Path, most: int, what: str) -> int:
    """Copy a member; a header that understates its size does not help it past `most` bytes."""
    done = 0
    with read() as data, target.open("wb") as out:
        while block := data.read(CHUNK):
            done += len(block)
            if done > most:
                raise DefrayError(f"{what} unpacks to more than it says: refused")
            out.write(block)
    return done
