"""The kind of machine that a compiled file is for, read from its first bytes.

Layouts: System V ABI chapter 4 (ELF), Microsoft's PE/COFF specification sections 2 and 3, Apple's
mach-o/loader.h, WebAssembly core specification section 5.5.
"""

import struct

ELF = {3: "x86", 40: "arm", 62: "x86_64", 183: "aarch64", 243: "riscv"}
PE = {0x014C: "x86", 0x8664: "x86_64", 0xAA64: "aarch64"}
MACH_O = {0x01000007: "x86_64", 0x0100000C: "aarch64"}
MACH_O_64 = 0xFEEDFACF
ARCHIVE = b"!<arch>\n"
MEMBER_HEADER = 60  # bytes, before each file in an archive


def describe_binary(data: bytes) -> str:
    """Return format and processor of a library or of the first object of an archive, "" of others."""
    try:
        if data[:4] == b"\x7fELF":
            order = "<" if data[5] == 1 else ">"
            return _name("ELF", ELF, struct.unpack_from(order + "H", data, 18)[0])
        if data[:4] == b"\0asm":
            return "WebAssembly"
        if data[:2] == b"MZ":
            start = struct.unpack_from("<I", data, 0x3C)[0]
            signed = data[start : start + 4] == b"PE\0\0"
            return _name("PE", PE, struct.unpack_from("<H", data, start + 4)[0]) if signed else ""
        if data[:4] == struct.pack("<I", MACH_O_64):
            return _name("Mach-O", MACH_O, struct.unpack_from("<I", data, 4)[0])
        if data[: len(ARCHIVE)] == ARCHIVE:
            return _describe_archive(data)
    except (struct.error, IndexError, ValueError):
        return ""
    return ""


def _describe_archive(data: bytes) -> str:
    """Return the format of the first object file of an archive; tables of names and symbols are skipped."""
    at = len(ARCHIVE)
    while at + MEMBER_HEADER <= len(data):
        name = data[at : at + 16].strip()
        size = int(data[at + 48 : at + 58])
        if name not in (b"/", b"//", b"/SYM64/"):
            start = at + MEMBER_HEADER
            return describe_binary(data[start : start + size])
        at += MEMBER_HEADER + size + size % 2
    return ""


def _name(form: str, processors: dict[int, str], number: int) -> str:
    return f"{form} for {processors.get(number, f'processor {number:#x}')}"
