"""How many bytes of a library are instructions and how many are tables, from its ELF section headers."""

import struct
from pathlib import Path

_CODE, _TABLES = (".text",), (".rodata", ".data.rel.ro")


def read_sections(path: Path) -> tuple[int, int] | None:
    """Return bytes of code and of constant tables, None if the file is no 64-bit little-endian ELF."""
    data = path.read_bytes()
    if data[:6] != b"\x7fELF\x02\x01":
        return None
    table = struct.unpack_from("<Q", data, 0x28)[0]
    entry, count, names_at = struct.unpack_from("<HHH", data, 0x3A)
    headers = [struct.unpack_from("<IIQQQQ", data, table + k * entry) for k in range(count)]
    names = headers[names_at][4]
    sizes = {"code": 0, "tables": 0}
    for name, _, _, _, _, size in headers:
        text = data[names + name : data.index(b"\0", names + name)].decode("ascii")
        if text.startswith(_CODE):
            sizes["code"] += size
        elif text.startswith(_TABLES):
            sizes["tables"] += size
    return sizes["code"], sizes["tables"]
