"""Which cases may run code of their own: those that the user says so of, now or once and for all.

The list is the file ``trusted`` in ``$TRIBOX_CONFIG`` (or ``$XDG_CONFIG_HOME/tribox``, or
``~/.config/tribox``): one directory a line, absolute and without symbolic links. What lies below
one is trusted. As the list decides what is run, it counts only if it is the user's own and
nobody else may write it.
"""

from __future__ import annotations

import grp
import os
import pwd
import stat
from collections.abc import Iterator
from pathlib import Path

from tribox.app.case.bodies import OwnBody
from tribox.app.case.case import Case
from tribox.app.case.friction import OwnLaw
from tribox.app.case.geometry import MeshGeometry
from tribox.app.errors import InputError
from tribox.geometry.meshes.drawing import GEO

CONTAINED = "TRIBOX_CONTAINED"
"""1 in the image, where what a drawing may do besides drawing reaches what is mounted only."""
_OPEN = (
    "APPTAINER_CONTAINER",
    "SINGULARITY_CONTAINER",
)  # these mount homes and working directories
OTHERS = stat.S_IWGRP | stat.S_IWOTH


def list_file() -> Path:
    """Where the list of trusted directories is kept; it need not be there.

    Raises:
        InputError: there is no place for it.
    """
    own = os.environ.get("TRIBOX_CONFIG")
    if own:
        return Path(own) / "trusted"
    above = os.environ.get("XDG_CONFIG_HOME")
    try:
        return (Path(above) if above else Path.home() / ".config") / "tribox" / "trusted"
    except RuntimeError:
        raise InputError("there is no home directory; name one in TRIBOX_CONFIG") from None


def trusted_directories() -> list[Path]:
    """The directories of the list, in its order.

    Raises:
        InputError: the list cannot be read, or is not the user's alone.
    """
    path = list_file()
    try:
        _see_that_it_is_ours(path.parent)
        _see_that_it_is_ours(path)
        lines = path.read_text(encoding="utf-8").splitlines()
    except FileNotFoundError:
        return []
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "is no text in UTF-8"
        raise InputError(f"{path}: cannot be read ({reason})") from None
    return [Path(line) for line in lines if os.path.isabs(line)]


def trust_directory(directory: Path) -> Path:
    """Put a directory on the list; returns it as it stands there.

    Raises:
        InputError: it is none, anybody may write in it, or the list cannot be written.
    """
    try:
        real = directory.resolve(strict=True)
        mode = real.stat().st_mode
    except (OSError, RuntimeError):
        raise InputError(f"{directory}: no such directory") from None
    if not stat.S_ISDIR(mode):
        raise InputError(f"{directory}: is no directory; trust is given to directories")
    if real == Path(real.anchor):
        raise InputError(f"{directory}: is everything there is; trust a directory of your own")
    if why := _open_to_others(real, real):
        raise InputError(f"{directory}: is not to be trusted{why}")
    if len(str(real).splitlines()) != 1:
        raise InputError(f"{str(directory)!r}: has a line break in its name")
    known = trusted_directories()
    if real not in known:
        _write([*known, real])
    return real


def forget_directory(directory: Path) -> Path:
    """Take a directory, which need not be there any more, off the list.

    Raises:
        InputError: it is not on the list, or the list cannot be written.
    """
    real, known = directory.resolve(), trusted_directories()
    if real not in known:
        above = next((one for one in known if one in real.parents), None)
        through = f"; it is trusted as a part of {above}" if above else ""
        raise InputError(f"{real}: is not on the list of trusted directories{through}")
    _write([one for one in known if one != real])
    return real


def code_files(case: Case, python: bool) -> list[tuple[str, Path]]:
    """(what says so, file) of all code that a case, or a value of its sweep, would run.

    Drawings are scripts of gmsh, which can start programs and write files.

    Args:
        python: whether its laws and materials are run, and not only its mesh made.
    """
    parts = [case, *(part for _, part in case.sweep_cases())]
    found: dict[tuple[str, Path], None] = {}
    for part in parts:
        for name, body in part.bodies.items() if python else ():
            if isinstance(body, OwnBody):
                found[f'bodies.{name}.material = "python"', body.file] = None
        for index, contact in enumerate(part.contact if python else ()):
            if isinstance(contact.friction, OwnLaw):
                found[f'contact.{index}.friction.law = "python"', contact.friction.file] = None
        geometry = part.geometry
        if isinstance(geometry, MeshGeometry):
            read = geometry.meshed or geometry.mesh
            if is_code(read):
                found["geometry.mesh", read] = None
    return list(found)


def is_code(drawing: Path) -> bool:
    """Whether meshing a drawing takes trust; STEP files hold no code."""
    contained = os.environ.get(CONTAINED) == "1" and not any(name in os.environ for name in _OPEN)
    return drawing.suffix.lower() in GEO and not contained


def require_trust(case: Case, case_file: Path, given: bool, python: bool = True) -> bool:
    """See that the code of a case may be run.

    Args:
        given: whether the user said so; python: see :func:`code_files`.

    Returns whether the case runs code.

    Raises:
        InputError: it does, and neither that was said nor are the case file and all files of code
            in directories that the user trusts.
    """
    files = code_files(case, python)
    if not files or given:
        return bool(files)
    for path, (place, file) in ((case_file, files[0]), *((one[1], one) for one in files)):
        said = f"{case_file}: {place} makes this case code: {file} would be run"
        require_trusted_file(path, said, exact=path == file and file.suffix not in GEO)
    return True


def require_drawing(drawing: Path) -> None:
    """See that a drawing holds no code, or lies where the user trusts all.

    Raises:
        InputError: it does not.
    """
    if is_code(drawing):
        said = f"{drawing} is code, which gmsh would run: it can start programs and write files"
        require_trusted_file(drawing, said)


def require_trusted_file(path: Path, said: str, exact: bool = False) -> None:
    """See that a file lies in a directory that the user trusts, and only he can have written it.

    Raises:
        InputError: it does not.
    """
    real = path.resolve()
    above = next((one for one in trusted_directories() if one in real.parents), None)
    why = "" if above is None else _open_to_others(real, above)
    if exact and real != path:
        why = f" ({path} has become a link)"
    if above is None or why:
        raise InputError(
            f"{said}{why}; allow it for this time with --trust, or for all in a directory with: "
            f"tribox trust {real.parent}"
        )


def _open_to_others(path: Path, above: Path) -> str:
    """Why a file below a trusted directory is not to be trusted all the same; "" if it is."""
    for one in (path, *path.parents):
        about = one.stat()
        if one in above.parents:
            # Who may write there may put another directory in the place of the trusted one.
            if about.st_mode & stat.S_IWOTH and not about.st_mode & stat.S_ISVTX:
                return f" (anybody may write {one})"
        elif about.st_uid not in (os.geteuid(), 0):
            return f" ({one} belongs to somebody else)"
        elif who := _others_who_write(about):
            return f" ({who} may write {one})"
    return ""


def _others_who_write(about: os.stat_result) -> str:
    """Who but the user may write a file: "anybody", its group unless it is his alone, or ""."""
    if about.st_mode & stat.S_IWOTH:
        return "anybody"
    if not about.st_mode & stat.S_IWGRP:
        return ""
    try:
        user, group = pwd.getpwuid(os.geteuid()), grp.getgrgid(about.st_gid)
    except KeyError:  # in a container, which knows no names: the primary group is taken for his
        return "" if about.st_gid == os.getegid() else f"group {about.st_gid}"
    own = group.gr_gid == user.pw_gid and group.gr_name == user.pw_name
    return "" if own and not set(group.gr_mem) - {user.pw_name} else f"group {group.gr_name}"


def _see_that_it_is_ours(path: Path) -> None:
    """Refuse a list, or its directory, that somebody else could write."""
    found = path.stat()
    if found.st_uid not in (os.geteuid(), 0):
        raise InputError(f"{path}: belongs to somebody else, so nothing in it is trusted")
    if found.st_mode & OTHERS:
        raise InputError(f"{path}: others may write it, so nothing in it is trusted (chmod go-w)")


def _write(directories: list[Path]) -> None:
    path = list_file()
    part = path.with_name("trusted.part")
    try:
        path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        _see_that_it_is_ours(path.parent)
        part.unlink(missing_ok=True)
        with os.fdopen(os.open(part, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w") as stream:
            stream.writelines(f"{one}\n" for one in directories)
        part.replace(path)
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror or error})") from None


def trust_lines() -> Iterator[str]:
    """What ``tribox trust --list`` prints."""
    for directory in trusted_directories():
        gone = "" if directory.is_dir() else " (is not there)"
        yield f"{directory}{gone}"
