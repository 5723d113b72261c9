"""Headers of shared libraries: ELF, PE and Mach-O, read without loading them.

Nothing here knows how a library was built.  Bytes that are no library raise ``ValueError``.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass, field

ELF_MACHINES = {62: "x86_64", 183: "aarch64"}
PE_MACHINES = {0x8664: "x86_64", 0xAA64: "aarch64"}
MACH_MACHINES = {0x01000007: "x86_64", 0x0100000C: "aarch64"}


@dataclass
class Binary:
    """A shared library for one processor."""

    kind: str
    machine: str
    exports: set[str] = field(default_factory=set)
    needs: set[str] = field(default_factory=set)
    """Libraries that are loaded with it."""
    imports: set[str] = field(default_factory=set)
    newest_glibc: tuple[int, ...] = ()
    """Of the symbol versions that an ELF file asks for."""
    oldest_macos: tuple[int, ...] = ()
    has_local_symbols: bool = False
    """Whether names are left in it that nobody needs who loads it."""
    signed: bool = False
    """Whether a Mach-O file has a code signature, without which macOS runs nothing on ARM."""
    search_paths: set[str] = field(default_factory=set)
    """Where an ELF file has other libraries looked for."""
    dated: bool = False
    """Whether a PE file holds the time of its making, where a digest may be."""


def read_binary(content: bytes) -> Binary:
    """Return what the headers of a library for one processor say.

    Raises:
        ValueError: no shared library of 64 bits, or a damaged one.
    """
    try:
        return _read(content)
    except (struct.error, IndexError, KeyError, OverflowError, UnicodeDecodeError) as error:
        raise ValueError(f"its header is damaged: {error}") from error


def _read(content: bytes) -> Binary:
    if content[:4] == b"\x7fELF":
        return _elf(content)
    if content[:2] == b"MZ":
        return _pe(content)
    if content[:4] == b"\xcf\xfa\xed\xfe":
        return _mach(content)
    raise ValueError(f"no shared library: it begins with {content[:8]!r}")


def is_universal(content: bytes) -> bool:
    """Whether a Mach-O file holds libraries for several processors."""
    return content[:4] == b"\xca\xfe\xba\xbe"


def slices(content: bytes) -> list[bytes]:
    """Return the parts of a Mach-O file for several processors; each begins at its page.

    Raises:
        ValueError: another file, or a damaged one.
    """
    try:
        return _slices(content)
    except (struct.error, IndexError) as error:
        raise ValueError(f"its header is damaged: {error}") from error


def _slices(content: bytes) -> list[bytes]:
    magic, count = struct.unpack_from(">II", content)
    _need(magic == 0xCAFEBABE, "no file for several processors")
    parts, end = [], 8 + 20 * count
    for index in range(count):
        cpu, _, start, size, align = struct.unpack_from(">IIIII", content, 8 + 20 * index)
        _need(align < 32 and start % (1 << align) == 0 and start >= end, "parts that overlap")
        end = start + size
        parts.append(content[start:end])
        _need(struct.unpack_from("<I", parts[-1], 4) == (cpu,), "a part of another processor")
    _need(end == len(content), "bytes behind its parts")
    return parts


def _need(holds: bool, otherwise: str) -> None:
    if not holds:
        raise ValueError(f"it has {otherwise}")


def _text(content: bytes, start: int) -> str:
    return content[start : content.index(b"\0", start)].decode()


SYMTAB, DYNSYM, DYNAMIC, VERNEED = 2, 11, 6, 0x6FFFFFFE  # kinds of ELF sections
DT_NEEDED, DT_RPATH, DT_RUNPATH = 1, 15, 29  # tags of the ELF dynamic section


def _elf(content: bytes) -> Binary:
    _need(content[4:6] == b"\x02\x01", "no 64 bits, or the other byte order")
    kind, machine = struct.unpack_from("<HH", content, 16)
    _need(kind == 3, "no kind of a shared object")
    binary = Binary("ELF", ELF_MACHINES.get(machine, f"processor {machine}"))
    table = struct.unpack_from("<Q", content, 40)[0]
    size, count = struct.unpack_from("<HH", content, 58)
    sections = [
        struct.unpack_from("<IIQQQQIIQQ", content, table + size * index) for index in range(count)
    ]
    for _, kind, _, _, start, length, link, info, _, _ in sections:
        names = sections[link][4]
        if kind == SYMTAB:
            binary.has_local_symbols = True
        elif kind == DYNSYM:
            for at in range(start + 24, start + length, 24):
                name, _, _, section = struct.unpack_from("<IBBH", content, at)
                (binary.exports if section else binary.imports).add(_text(content, names + name))
        elif kind == DYNAMIC:
            for tag, value in struct.iter_unpack("<QQ", content[start : start + length]):
                if tag in (DT_RPATH, DT_RUNPATH):
                    binary.search_paths.add(_text(content, names + value))
                if tag == DT_NEEDED:
                    binary.needs.add(_text(content, names + value))
        elif kind == VERNEED:
            binary.newest_glibc = max(_versions(content, start, info, names), default=())
    return binary


def _versions(content: bytes, start: int, count: int, names: int) -> list[tuple[int, ...]]:
    """Symbol versions of glibc that an ELF file asks for."""
    versions = []
    for _ in range(count):
        _, several, _, first, following = struct.unpack_from("<HHIII", content, start)
        at = start + first
        for _ in range(several):
            _, _, _, name, after = struct.unpack_from("<IHHII", content, at)
            library, _, numbers = _text(content, names + name).partition("_")
            if library == "GLIBC" and numbers.replace(".", "").isdigit():
                versions.append(tuple(int(number) for number in numbers.split(".")))
            if not after:
                break
            at += after
        if not following:
            break
        start += following
    return versions


DLL = 0x2000  # bit in the characteristics of a PE file
EXPORTS, IMPORTS, DEBUG = 0, 1, 6  # data directories of a PE file
REPRODUCIBLE = 16  # kind of debug entry that a reproducible build has


def _pe(content: bytes) -> Binary:
    head = struct.unpack_from("<I", content, 60)[0]
    _need(content[head : head + 4] == b"PE\0\0", "no header of Windows")
    fields = struct.unpack_from("<HHIIIHH", content, head + 4)
    machine, count, stamp, symbols, _, size, flags = fields
    _need(bool(flags & DLL), "no kind of a DLL")
    machine_name = PE_MACHINES.get(machine, f"processor {machine:#x}")
    binary = Binary("PE", machine_name, has_local_symbols=symbols != 0)
    option = head + 24
    _need(struct.unpack_from("<H", content, option) == (0x20B,), "no 64 bits")
    sections = [
        struct.unpack_from("<8sIIII", content, option + size + 40 * index) for index in range(count)
    ]

    def at(address: int) -> int:
        """Offset in the file of an address of the loaded library."""
        for _, _, start, length, offset in sections:
            if start <= address < start + length:
                return int(address - start + offset)
        raise ValueError(f"no section of it has the address {address:#x}")

    def directory(index: int) -> tuple[int, int]:
        address, length = struct.unpack_from("<II", content, option + 112 + 8 * index)
        return (at(address) if address else 0), length

    start, _ = directory(EXPORTS)
    if start:
        amount, _, names = struct.unpack_from("<III", content, start + 24)
        for address in struct.unpack_from(f"<{amount}I", content, at(names)):
            binary.exports.add(_text(content, at(address)))
    start, _ = directory(IMPORTS)
    while start and (name := struct.unpack_from("<I", content, start + 12)[0]):
        binary.needs.add(_text(content, at(name)))
        start += 20
    start, length = directory(DEBUG)
    kinds = [struct.unpack_from("<I", content, start + at + 12)[0] for at in range(0, length, 28)]
    binary.dated = stamp != 0 and REPRODUCIBLE not in kinds
    return binary


SYMBOLS, LIBRARY, SIGNATURE, OLDEST, OLDEST_MAC = 0x2, 0xC, 0x1D, 0x32, 0x24  # Mach-O load commands
DEBUGGING, PRIVATE, DEFINED, EXTERNAL = 0xE0, 0x10, 0xE, 0x1  # bits of a Mach-O symbol


def _mach(content: bytes) -> Binary:
    _, cpu, _, kind, count = struct.unpack_from("<IIIII", content)
    _need(kind in (6, 8), "no kind of a dynamic library or bundle")
    binary = Binary("Mach-O", MACH_MACHINES.get(cpu, f"processor {cpu:#x}"))
    start = 32
    for _ in range(count):
        command, size = struct.unpack_from("<II", content, start)
        if command == SYMBOLS:
            first, amount, names, _ = struct.unpack_from("<IIII", content, start + 8)
            for at in range(first, first + 16 * amount, 16):
                name, sort = struct.unpack_from("<IB", content, at)
                binary.has_local_symbols |= bool(sort & DEBUGGING)
                if sort & EXTERNAL and not sort & (DEBUGGING | PRIVATE):
                    names_of = binary.exports if sort & DEFINED else binary.imports
                    names_of.add(_text(content, names + name).removeprefix("_"))
        elif command == LIBRARY:
            where = struct.unpack_from("<I", content, start + 8)[0]
            binary.needs.add(_text(content, start + where))
        elif command == SIGNATURE:
            binary.signed = True
        elif command in (OLDEST, OLDEST_MAC):
            version = struct.unpack_from("<I", content, start + (12 if command == OLDEST else 8))[0]
            binary.oldest_macos = (version >> 16, version >> 8 & 0xFF)
        _need(size >= 8, "a load command without end")
        start += size
    return binary
