"""One writer at a time for a file and what lies beside it."""

from __future__ import annotations

import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from kinetic_solver.errors import SceneError


@contextmanager
def one_writer(target: Path) -> Iterator[None]:
    """Holds the lock of `target`, the file `<target>.lock` beside it, which is gone afterwards.

    The lock is the system's (flock): that of a process that was killed is free, and its file is taken over. Raises SceneError
    where another process holds it, and where the folder cannot be written to.
    Tests: tests/faults/test_lock.py.
    """
    path = target.with_name(target.name + ".lock")
    descriptor = _locked(target, path)
    try:
        yield
    finally:
        path.unlink(missing_ok=True)  # while the lock is held: whoever opened it meanwhile finds it gone and tries again
        os.close(descriptor)


def _locked(target: Path, path: Path) -> int:
    while True:
        try:
            descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
        except OSError as error:
            reason = "its folder does not exist" if not target.parent.is_dir() else error.strerror
            raise SceneError(f"{target}: cannot be created ({reason})") from None
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            writer = os.read(descriptor, 20).decode(errors="replace").strip()
            os.close(descriptor)
            who = f"process {writer}" if writer else "another process"
            raise SceneError(f"{target}: is being written by {who}; allowed: another name, or to wait for its end") from None
        if _is(descriptor, path):
            os.ftruncate(descriptor, 0)
            os.pwrite(descriptor, f"{os.getpid()}\n".encode(), 0)
            return descriptor
        os.close(descriptor)  # its owner removed it between opening and locking


def _is(descriptor: int, path: Path) -> bool:
    try:
        there, here = path.stat(), os.fstat(descriptor)
    except FileNotFoundError:
        return False
    return (there.st_dev, there.st_ino) == (here.st_dev, here.st_ino)
