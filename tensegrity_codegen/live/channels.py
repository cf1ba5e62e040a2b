"""Arrays inside a page: compressed, in base64, in the shortest type that keeps the stated rounding."""

import base64
import gzip
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

MOST_FLOATS = 1_500_000  # numbers of an array that are kept in single precision; more take 16 bit each
STEPS = 32000  # of a 16-bit number, to each side of zero
UNKNOWN = -32768


@dataclass(frozen=True)
class Channel:
    """An array as a page holds it.

    kind: type of the numbers: ``"float64"``, ``"float32"``, ``"int32"``, ``"int16"`` or ``"uint8"``.
    shape: shape; the first axis runs over rows.
    data: the numbers, little-endian, compressed by gzip, in base64.
    scale, offset: of 16-bit numbers: value = number * scale + offset; one entry, or one for each place of the
        last axis.
    rounding: largest difference from the given array.
    """

    kind: str
    shape: tuple[int, ...]
    data: str
    scale: tuple[float, ...] = ()
    offset: tuple[float, ...] = ()
    rounding: float = 0.0

    def describe(self) -> dict[str, Any]:
        """Return all but the data, in JSON's types."""
        return {"kind": self.kind, "shape": self.shape, "scale": self.scale, "offset": self.offset}


def pack(values: ArrayLike, kind: str) -> Channel:
    """Return an array as it is, in the type `kind`."""
    array = np.ascontiguousarray(values, dtype=np.dtype(kind).newbyteorder("<"))
    return Channel(kind, array.shape, _compress(array.tobytes()))


def pack_rounded(values: NDArray[np.float64], *, by_place: bool = False) -> Channel:
    """Return an array in single precision, a large one as 16-bit numbers of equal steps.

    values (n_rows, ...): numbers; NaN stands for what is not known; by_place: whether each place of the last
    axis has steps of its own, centred on its range; else zero is exact, and what is not zero keeps its sign.
    """
    array = np.asarray(values, dtype=np.float64)
    if array.size <= MOST_FLOATS:
        single = array.astype("<f4")
        rounding = float(np.nanmax(np.abs(single - array), initial=0.0))
        return Channel("float32", array.shape, _compress(single.tobytes()), rounding=rounding)
    flat = array.reshape(-1, array.shape[-1]) if by_place else array.reshape(-1, 1)
    low, high = (np.nan_to_num(end.reduce(flat, axis=0)) for end in (np.fmin, np.fmax))
    offset = (low + high) / 2 if by_place else np.zeros(1)
    reach = np.maximum(np.abs(low - offset), np.abs(high - offset))
    scale = np.where(reach > 0, reach / STEPS, 1.0)
    number = np.rint((flat - offset) / scale)
    if not by_place:
        number = np.where((number == 0) & (flat != 0), np.sign(flat), number)
    rounding = float(np.nanmax(np.abs(number * scale + offset - flat), initial=0.0))
    whole = np.where(np.isnan(number), UNKNOWN, number).astype("<i2").reshape(array.shape[0], -1)
    steps = np.diff(whole, axis=0, prepend=np.zeros((1, whole.shape[1]), dtype="<i2"))  # modulo 2^16
    data = _compress(np.ascontiguousarray(steps, dtype="<i2").tobytes())
    return Channel("int16", array.shape, data, tuple(scale.tolist()), tuple(offset.tolist()), rounding)


def pack_text(text: str) -> str:
    """Return text compressed, in base64."""
    return _compress(text.encode("utf-8"))


def _compress(data: bytes) -> str:
    return base64.b64encode(gzip.compress(data, compresslevel=9, mtime=0)).decode("ascii")
