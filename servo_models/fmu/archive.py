"""An FMU's files, unpacked within limits: nothing of the archive is trusted.

Names, sizes and the description are judged as the archive is unpacked.
"""

from __future__ import annotations

import contextlib
import stat
import zipfile
from collections.abc import Iterator
from pathlib import Path, PurePosixPath
from xml.parsers import expat

from servo_models.errors import CuredError, UserError
from servo_models.files import scratch

DESCRIPTION = "modelDescription.xml"
MOST_FILES = 10_000  # files in an archive at most
LARGEST_DESCRIPTION = 4_000_000  # bytes of XML; one with 200 variables has 60 000
DEEPEST = 20  # nested elements in a description at most; FMI 2.0 needs 5
MOST_ELEMENTS = 100_000  # elements in a description at most
LONGEST_NAME = 1000  # characters of a variable's name: the time to judge it grows with their square
PIECE = 1 << 20  # bytes that are unpacked at a time
COMPRESSION = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)  # FMI 2.0.4, section 2.3


@contextlib.contextmanager
def unpacked(path: Path, megabytes: float) -> Iterator[Path]:
    """A temporary folder with the files of an FMU, ``megabytes`` together at most; it goes at the
    end.

    Raises:
        UserError: no zip, a name that leads elsewhere, too much, or a description that has
            more than elements and text.
    """
    limit = int(megabytes * 2**20)
    if (packed := path.stat().st_size) > limit:
        raise CuredError(_too_large(packed, limit))
    with scratch() as folder:
        with zipfile.ZipFile(path) as archive:
            _extract(archive, folder, limit)
        check_xml(folder / DESCRIPTION)
        yield folder


def _extract(archive: zipfile.ZipFile, folder: Path, left: int) -> None:
    entries = archive.infolist()
    _check_names(entries)
    if (told := sum(entry.file_size for entry in entries)) > left:
        raise CuredError(_too_large(told, left))
    limit = left
    for entry in entries:
        target = folder / entry.filename
        if entry.is_dir():
            target.mkdir(parents=True, exist_ok=True)
            continue
        target.parent.mkdir(parents=True, exist_ok=True)
        with archive.open(entry) as read, target.open("xb") as write:
            while piece := read.read(PIECE):  # the size that the archive tells may be wrong
                left -= len(piece)
                if left < 0:
                    raise CuredError(_too_large(limit - left, limit))
                write.write(piece)


def _check_names(entries: list[zipfile.ZipInfo]) -> None:
    if len(entries) > MOST_FILES:
        raise UserError(f"it has {len(entries)} files, more than {MOST_FILES}: no FMU needs that")
    names: set[str] = set()
    for entry in entries:
        name = entry.filename
        parts = PurePosixPath(name).parts
        shown = repr(name[:80])
        if not parts or name.startswith("/") or ".." in parts or "\\" in name or ":" in name:
            raise UserError(f"its file {shown} would be written outside its folder")
        if not name.isprintable() or len(name) > 200:
            raise UserError(f"its file {shown} has no name of an FMU's file")
        if stat.S_IFMT(entry.external_attr >> 16) not in (0, stat.S_IFREG, stat.S_IFDIR):
            raise UserError(f"its file {shown} is a link or a device, which an FMU has not")
        if entry.flag_bits & 1 or entry.compress_type not in COMPRESSION:
            raise UserError(f"its file {shown} is packed in a way that FMI does not know")
        if "/".join(parts).casefold() in names:
            raise UserError(f"its file {shown} is there twice")
        names.add("/".join(parts).casefold())


def _too_large(size: int, limit: int) -> str:
    return (
        f"unpacked it has {size / 2**20:.0f} MB or more, the limit is {limit / 2**20:.0f} MB;"
        " raise it with --unpacked if you trust the file"
    )


def check_xml(path: Path) -> None:
    """Refuse XML that is costly to read, before a tree is built of it.

    Raises:
        UserError: no such file, or one that cannot be a description.
    """
    if not path.is_file():
        raise UserError(f"it has no {path.name}")
    if path.stat().st_size > LARGEST_DESCRIPTION:
        raise UserError(f"{path.name} has {path.stat().st_size} bytes, which no description has")
    depth = elements = 0

    def begin(name: str, attributes: dict[str, str]) -> None:
        nonlocal depth, elements
        depth += 1
        elements += 1
        if len(attributes.get("name", "")) > LONGEST_NAME:
            raise UserError(f"{path.name} has a name of more than {LONGEST_NAME} characters")
        if depth > DEEPEST or elements > MOST_ELEMENTS:
            raise UserError(f"{path.name} has more or deeper elements than a description")

    def end(name: str) -> None:
        nonlocal depth
        depth -= 1

    def doctype(*_: object) -> None:
        raise UserError(f"{path.name} has a DOCTYPE, which FMI does not know")

    parser = expat.ParserCreate()
    parser.StartElementHandler = begin
    parser.EndElementHandler = end
    parser.StartDoctypeDeclHandler = doctype
    try:
        parser.Parse(path.read_bytes(), True)
    except (expat.ExpatError, ValueError, LookupError) as error:
        raise UserError(f"{path.name} is no XML: {error}") from error
