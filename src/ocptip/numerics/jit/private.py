"""Folders of machine code, which is executed: it is loaded only if no other user can have put it there.

A folder that another user owns or can write to is left alone. A private one takes its place until the process
ends, and one warning says so.
"""

from __future__ import annotations

import atexit
import contextlib
import os
import secrets
import shutil
import stat
import tempfile
from functools import lru_cache
from pathlib import Path

from ocptip.basics.errors import doubt

CACHE = "OCPTIP_CACHE_DIR"
"""The environment variable that names another folder than that of the user's caches."""
_OTHERS = stat.S_IWGRP | stat.S_IWOTH


def complaint(folder: Path) -> str:
    """Why machine code in a folder cannot be trusted; empty where it can, or there is no such folder."""
    if not hasattr(os, "getuid"):  # Windows: folders of the profile are the user's
        return ""
    try:
        about = folder.lstat()
    except OSError:
        return ""
    if stat.S_ISLNK(about.st_mode):
        return "is a symbolic link"
    if not stat.S_ISDIR(about.st_mode):
        return ""
    if about.st_uid != os.getuid():
        return f"belongs to user {about.st_uid}"
    if about.st_mode & _OTHERS:
        return f"can be written by others (mode {stat.S_IMODE(about.st_mode):o})"
    return ""


def trusted(folder: Path) -> Path:
    """The folder; with a warning a private one for this run where others could put machine code into it."""
    why = complaint(folder)
    return _instead(folder, why) if why else folder


@lru_cache
def _instead(folder: Path, why: str) -> Path:
    """A private folder instead of another one, with a warning, once."""
    made = _temporary()
    doubt(
        f"the cache folder {folder} {why}: machine code in it is not loaded, and a private folder is used "
        "for this run; remove it, or make it yours alone (chmod 700)"
    )
    return made


@lru_cache
def _temporary() -> Path:
    """Made for this process, which also removes it; processes that it starts use it too."""
    folder = Path(tempfile.mkdtemp(prefix="ocptip-"))
    maker = os.getpid()
    atexit.register(lambda: shutil.rmtree(folder, ignore_errors=True) if os.getpid() == maker else None)
    os.environ[CACHE] = str(folder)
    return folder / "ocptip"


def read_private(path: Path) -> bytes | None:
    """The content of a file that only this user can have written; None without one.

    Folder and file are opened first and checked then, so that nobody can exchange them in between.
    """
    with contextlib.suppress(OSError), _Folder(path.parent) as folder:
        return folder.read(path.name)
    return None


def write_private(path: Path, content: bytes) -> None:
    """Write a file that only this user can read or write, whole or not at all; its folder is made."""
    path.parent.parent.mkdir(parents=True, exist_ok=True)
    path.parent.mkdir(mode=0o700, exist_ok=True)
    with _Folder(path.parent) as folder:
        folder.write(path.name, content)


class _Folder:
    """An open folder of this user; OSError where others can write to it."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._descriptor: int | None = None

    def __enter__(self) -> _Folder:
        if os.open in os.supports_dir_fd:
            self._descriptor = os.open(self._path, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
            if not _is_private(self._descriptor):
                self.__exit__()
                raise PermissionError(f"{self._path} can be written by others")
        return self

    def __exit__(self, *_: object) -> None:
        if self._descriptor is not None:
            os.close(self._descriptor)
            self._descriptor = None

    def read(self, name: str) -> bytes | None:
        flags = os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)
        descriptor = self._open(name, flags | getattr(os, "O_BINARY", 0))
        with os.fdopen(descriptor, "rb") as stream:
            private = stat.S_ISREG(os.fstat(descriptor).st_mode) and _is_private(descriptor)
            return stream.read() if private else None

    def write(self, name: str, content: bytes) -> None:
        temporary = f".{secrets.token_hex(8)}.part"
        flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0)
        placing = {"src_dir_fd": self._descriptor, "dst_dir_fd": self._descriptor}
        try:
            with os.fdopen(self._open(temporary, flags), "wb") as stream:
                stream.write(content)
            os.replace(self._named(temporary), self._named(name), **placing)
        except BaseException:
            with contextlib.suppress(OSError):
                os.unlink(self._named(temporary), dir_fd=self._descriptor)
            raise

    def _open(self, name: str, flags: int) -> int:
        return os.open(self._named(name), flags, 0o600, dir_fd=self._descriptor)

    def _named(self, name: str) -> str:
        return name if self._descriptor is not None else str(self._path / name)


def _is_private(descriptor: int) -> bool:
    about = os.fstat(descriptor)
    return about.st_uid == os.getuid() and not about.st_mode & _OTHERS
