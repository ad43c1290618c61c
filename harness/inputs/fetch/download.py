"""Downloads that resume, and whose size and SHA-256 are verified before anything uses them."""

from __future__ import annotations

import errno
import hashlib
import http.client
import shutil
import urllib.error
import urllib.request
from collections.abc import Callable
from pathlib import Path
from urllib.parse import urlsplit

from harness.errors import DefrayError

CHUNK = 1 << 20  # bytes read at once
SECONDS = 30  # a server silent for longer is given up
ATTEMPTS = 4  # connections for one file; each goes on where the one before ended
LARGEST = 8 << 30  # bytes of a file whose size is not known beforehand
FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
Progress = Callable[[int, int | None], None]  # bytes so far, bytes in all where known


class Unreachable(DefrayError):
    """No connection to the server at all."""


class _Interrupted(Exception):
    """The connection ended early; what came is on disk."""


def download(
    url: str, target: Path, size: int | None = None, sha256: str | None = None, progress: Progress | None = None
) -> str:
    """Fetch `url` into `target` and return its SHA-256; `target` appears only when whole and verified.

    What came before an interruption stays in `target.part`, and the next call goes on there; without `sha256`,
    which alone can tell that the two parts belong together, it starts anew. Raises Unreachable where no connection
    is made, and DefrayError for an HTTP error, another size or hash than expected, or a full disk.
    """
    part = target.with_name(f"{target.name}.part")
    if sha256 is None:
        part.unlink(missing_ok=True)
    if size is not None:
        check_room(target.parent, size - (part.stat().st_size if part.exists() else 0), url)
    for attempt in range(ATTEMPTS):
        try:
            _go_on(url, part, size, progress or (lambda done, total: None))
            break
        except _Interrupted as stop:
            if attempt == ATTEMPTS - 1:
                raise DefrayError(f"{url}: {stop}; the same command goes on from there") from None
    found = hash_of(part)
    if sha256 is not None and found != sha256:
        part.unlink()
        raise DefrayError(f"{url} is not the expected archive: SHA-256 {found}, expected {sha256}; nothing was kept")
    part.replace(target)
    return found


def hash_of(path: Path) -> str:
    """SHA-256 of a file."""
    with path.open("rb") as data:
        return hashlib.file_digest(data, "sha256").hexdigest()


def check_room(folder: Path, size: int, what: str) -> None:
    """Raise DefrayError where `folder`'s disk lacks `size` bytes for `what`."""
    free = shutil.disk_usage(folder).free
    if size > free:
        raise DefrayError(f"{what} needs {size / 1e6:,.0f} MB in {folder}, where {free / 1e6:,.0f} MB are free")


def _go_on(url: str, part: Path, size: int | None, progress: Progress) -> None:
    """One connection: append to `part` what it lacks."""
    have = part.stat().st_size if part.exists() else 0
    if size is not None and have >= size:
        if have == size:
            return
        part.unlink()  # longer than the archive: left by something else
        have = 0
    headers = {"User-Agent": "defray", "Accept-Encoding": "identity"} | ({"Range": f"bytes={have}-"} if have else {})
    with _opened(urllib.request.Request(url, headers=headers), part) as answer:
        have = have if answer.status == 206 and _starts_at(answer, have) else 0
        length = answer.headers.get("Content-Length")
        total = have + int(length) if length else size
        if size is not None and total != size:
            raise DefrayError(f"{url} has {total:,} bytes, expected {size:,}: it is not the archive known here")
        try:
            with part.open("ab" if have else "wb") as out:
                done = _copy(answer, out, have, total or LARGEST, lambda done: progress(done, total))
        except OSError as error:
            _explain(error, url, part)
    if total is not None and done < total:
        raise _Interrupted(f"the connection ended after {done:,} of {total:,} bytes")
    if not total and done >= LARGEST:
        raise DefrayError(f"{url} is larger than {LARGEST / 1e9:.0f} GB")


def _opened(request: urllib.request.Request, part: Path):
    """The server's answer; raises Unreachable or DefrayError instead of urllib's many errors."""
    try:
        return urllib.request.urlopen(request, timeout=SECONDS)
    except urllib.error.HTTPError as error:
        error.close()
        if error.code == 416:  # the part on disk is not of this file
            part.unlink(missing_ok=True)
            raise _Interrupted("the server does not know the part that was kept") from None
        raise DefrayError(f"{request.full_url}: HTTP {error.code} {error.reason}") from None
    except (OSError, http.client.HTTPException) as error:  # URLError is an OSError
        reason = getattr(error, "reason", error)
        reason = getattr(reason, "strerror", None) or reason
        raise Unreachable(f"no connection to {urlsplit(request.full_url).netloc}: {reason}") from None


def _starts_at(answer, place: int) -> bool:
    """Whether a partial answer begins where the part on disk ends."""
    return (answer.headers.get("Content-Range") or "").startswith(f"bytes {place}-")


def _copy(answer, out, done: int, most: int, progress: Callable[[int], None]) -> int:
    """Write the answer's body; returns the bytes in the file, fewer than announced where the server closed early."""
    while done < most:
        try:
            block = answer.read(min(CHUNK, most - done))
        except (http.client.HTTPException, TimeoutError, ConnectionError):
            raise _Interrupted(f"the connection broke after {done:,} bytes") from None
        if not block:
            break
        out.write(block)
        done += len(block)
        progress(done)
    return done


def _explain(error: OSError, url: str, part: Path) -> None:
    if error.errno in FULL:
        raise DefrayError(f"the disk of {part.parent} is full; make room, and the same command goes on") from None
    raise DefrayError(f"cannot write {part}: {error.strerror or error} (from {url})") from None
