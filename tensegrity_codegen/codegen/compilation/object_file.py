"""Size of the machine code in an object file, read from its section headers.

Layouts: System V ABI chapter 4 (ELF), Apple's mach-o/loader.h (Mach-O, 64 bit), Microsoft's PE/COFF
specification section 4, WebAssembly core specification section 5.5.
"""

import struct

ELF_ALLOCATED, ELF_WRITABLE, ELF_NO_BITS = 2, 1, 8
MACHO_64 = 0xFEEDFACF
MACHO_SEGMENT_64 = 0x19
COFF_MACHINES = (0x8664, 0xAA64, 0x014C)
WASM_CODE, WASM_DATA = 10, 11
CODE_NAMES = (".text", ".rodata", ".rdata")


def read_code_size(data: bytes) -> int | None:
    """Return the bytes of code and constants in an object file, None if its format is not known.

    Counted are .text*, .rodata* and .rdata* sections, and those of the segment __TEXT; not counted are data,
    symbols, relocations, debug and unwind information.
    """
    try:
        if data[:4] == b"\x7fELF":
            return _read_elf(data)
        if data[:4] == b"\0asm":
            return _read_wasm(data)
        if len(data) >= 4 and struct.unpack_from("<I", data)[0] == MACHO_64:
            return _read_macho(data)
        if len(data) >= 2 and struct.unpack_from("<H", data)[0] in COFF_MACHINES:
            count = struct.unpack_from("<H", data, 2)[0]
            first = 20 + struct.unpack_from("<H", data, 16)[0]
            headers = [first + 40 * k for k in range(count)]
            code = [at for at in headers if _text(data, at, 8).startswith(CODE_NAMES)]
            size: int = sum(struct.unpack_from("<I", data, at + 16)[0] for at in code)
            return size
    except (struct.error, IndexError, ValueError, OverflowError):
        return None
    return None


def _read_elf(data: bytes) -> int:
    order = "<" if data[5] == 1 else ">"
    wide = data[4] == 2
    table = struct.unpack_from(order + ("Q" if wide else "I"), data, 0x28 if wide else 0x20)[0]
    entry_size, count, names_at = struct.unpack_from(order + "HHH", data, 0x3A if wide else 0x2E)
    layout = order + ("IIQQQQ" if wide else "IIIIII")  # name, type, flags, address, offset, size
    sections = [struct.unpack_from(layout, data, table + k * entry_size) for k in range(count)]
    names = sections[names_at][4]
    total = 0
    for name, kind, flags, _, _, size in sections:
        stored = flags & ELF_ALLOCATED and not flags & ELF_WRITABLE and kind != ELF_NO_BITS
        if stored and _text(data, names + name).startswith(CODE_NAMES):
            total += size
    return total


def _read_macho(data: bytes) -> int:
    commands = struct.unpack_from("<I", data, 16)[0]
    total, at = 0, 32
    for _ in range(commands):
        command, size = struct.unpack_from("<II", data, at)
        if command == MACHO_SEGMENT_64:
            for k in range(struct.unpack_from("<I", data, at + 64)[0]):
                section = at + 72 + 80 * k
                if _text(data, section + 16, 16) == "__TEXT" and _text(data, section, 16) != "__eh_frame":
                    total += struct.unpack_from("<Q", data, section + 40)[0]
        at += size
    return total


def _read_wasm(data: bytes) -> int:
    """Add up the sections of code and of data; constants are among the latter."""
    total, at = 0, 8
    while at < len(data):
        kind = data[at]
        size, at = _read_leb128(data, at + 1)
        if kind in (WASM_CODE, WASM_DATA):
            total += size
        at += size
    return total


def _read_leb128(data: bytes, at: int) -> tuple[int, int]:
    """Return an unsigned number of variable length, and the place after it."""
    value = shift = 0
    while True:
        byte = data[at]
        value |= (byte & 0x7F) << shift
        at, shift = at + 1, shift + 7
        if byte < 0x80:
            return value, at


def _text(data: bytes, start: int, most: int | None = None) -> str:
    """Return the text that starts there and ends at a zero byte, or after `most` bytes."""
    end = data.find(b"\0", start)
    end = len(data) if end < 0 else end
    return data[start : end if most is None else min(end, start + most)].decode("ascii", "replace")


def read_stack_use(text: str) -> dict[str, int]:
    """Return the bytes of each function in what gcc and clang write with -fstack-usage.

    A line is "file:line:column:function", bytes and a kind, apart by tabs.
    """
    rows = (line.split("\t") for line in text.splitlines())
    return {row[0].rpartition(":")[2]: int(row[1]) for row in rows if len(row) == 3 and row[1].isdigit()}
