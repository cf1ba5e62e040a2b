"""Chunks of stored arrays as they were written: their size is known before anything is expanded."""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from tensegrity_codegen.system.extras import SWEEP, import_extra

CRC_BYTES = 4  # of the checksum at the end of a chunk
CODECS = {True: ["vlen-utf8", "zstd", "crc32c"], False: ["bytes", "blosc", "crc32c"]}  # of text, of numbers
MAX_CHUNKS = 2_000_000  # of an array
MAX_TEXT_BYTES, OTHER_BYTES = 4096, 2**16  # of an entry of text on average; of what is in each chunk besides


def check_array(array: Mapping[str, Any]) -> None:
    """Raise ValueError, or an error of look-ups or types, for an array that no sweep has written."""
    parts = array["chunk_grid"]["configuration"]["chunk_shape"]
    numbers = [*array["shape"], *parts]
    is_counted = all(type(number) is int and number >= 0 for number in numbers) and min(parts, default=1) > 0
    codecs = [codec["name"] for codec in array["codecs"]]
    if not is_counted or codecs != CODECS[array["data_type"] == "string"]:
        raise ValueError("an array of another kind")
    places = (-(-size // part) for size, part in zip(array["shape"], parts, strict=True))
    if math.prod(places) > MAX_CHUNKS:
        raise ValueError("an array with too many chunks")


def is_whole(file: Path, array: Mapping[str, Any]) -> bool:
    """Return whether a chunk has the checksum (CRC-32C), the size and the kind of what was written."""
    is_text = array["data_type"] == "string"
    count: int = math.prod(array["chunk_grid"]["configuration"]["chunk_shape"])
    most = OTHER_BYTES + count * (MAX_TEXT_BYTES if is_text else np.dtype(array["data_type"]).itemsize)
    try:
        if file.stat().st_size > most:
            return False
        data = file.read_bytes()
    except OSError:
        return False
    content, checksum = data[:-CRC_BYTES], data[-CRC_BYTES:]
    found = import_extra("google_crc32c", SWEEP).value(content)
    if not content or found != int.from_bytes(checksum, "little"):
        return False
    numcodecs = import_extra("numcodecs", SWEEP)
    try:
        if not is_text:
            size = int.from_bytes(content[4:8], "little")
            return size == most - OTHER_BYTES and len(numcodecs.blosc.decompress(content)) == size
        if read_frame_size(content) > most:
            return False
        text = numcodecs.zstd.decompress(content)
        return int.from_bytes(text[:4], "little") == count == len(numcodecs.VLenUTF8().decode(text))
    except (IndexError, RuntimeError, ValueError):
        return False


def read_frame_size(data: bytes) -> int:
    """Return the size that the header of a frame of Zstandard states (RFC 8878, section 3.1.1.1).

    Raises ValueError or IndexError where it states none.
    """
    is_single = data[4] >> 5 & 1
    width = (is_single, 2, 4, 8)[data[4] >> 6]
    if data[:4] != b"\x28\xb5\x2f\xfd" or not width:
        raise ValueError("no frame with a size")
    first = 6 - is_single + (0, 1, 2, 4)[data[4] & 3]
    return int.from_bytes(data[first : first + width], "little") + 256 * (width == 2)
