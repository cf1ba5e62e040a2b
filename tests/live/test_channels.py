"""Arrays of a page: what is written is read back to the stated rounding."""

import base64
import gzip

import numpy as np
import pytest

from tensegrity_codegen.live import channels
from tensegrity_codegen.live.channels import Channel, pack, pack_rounded, pack_text


def unpack(channel: Channel) -> np.ndarray:
    raw = gzip.decompress(base64.b64decode(channel.data))
    values = np.frombuffer(raw, dtype=np.dtype(channel.kind).newbyteorder("<")).reshape(channel.shape)
    if channel.kind != "int16":
        return values.astype(float)
    rows = values.reshape(channel.shape[0], -1).copy()
    for k in range(1, len(rows)):
        rows[k] += rows[k - 1]
    last = np.where(rows == channels.UNKNOWN, np.nan, rows).reshape(-1, len(channel.scale))
    return (last * np.array(channel.scale) + np.array(channel.offset)).reshape(channel.shape)


@pytest.mark.parametrize("kind", ["float64", "float32", "int32", "uint8"])
def test_an_array_is_kept_as_it_is(kind: str) -> None:
    values = np.arange(24).reshape(2, 3, 4)
    channel = pack(values, kind)
    assert channel.rounding == 0.0
    assert np.array_equal(unpack(channel), values)


@pytest.mark.parametrize("most", [10**6, 10])
@pytest.mark.parametrize("by_place", [False, True])
def test_the_stated_rounding_holds(most: int, by_place: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(channels, "MOST_FLOATS", most)
    random = np.random.default_rng(3)
    values = random.normal(size=(40, 7, 3)) * np.array([1e-3, 1.0, 50.0])
    channel = pack_rounded(values, by_place=by_place)
    assert channel.kind == ("float32" if most > 10 else "int16")
    difference = np.abs(unpack(channel) - values)
    assert 0 < difference.max() <= channel.rounding * (1 + 1e-12)
    if by_place and most == 10:  # each place has steps that suit it
        assert (difference.max(axis=(0, 1)) <= np.ptp(values, axis=(0, 1)) / 50000).all()


@pytest.mark.parametrize("most", [10**6, 10])
def test_zero_signs_and_unknown_numbers_are_kept(most: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(channels, "MOST_FLOATS", most)
    values = np.array([[0.0, 1e-6, -1e-6, 100.0], [np.nan, 0.0, 3.0, -100.0], [0.0] * 4, [np.nan] * 4])
    found = unpack(pack_rounded(values))
    assert np.array_equal(np.isnan(found), np.isnan(values))
    assert np.array_equal(np.sign(found[0]), np.sign(values[0]))


@pytest.mark.parametrize("most", [10**6, 0])
def test_arrays_without_known_numbers_are_kept(most: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(channels, "MOST_FLOATS", most)
    for values in (np.full((2, 3), np.nan), np.zeros((2, 3)), np.full((1, 3), 5.0)):
        channel = pack_rounded(values, by_place=True)
        assert unpack(channel) == pytest.approx(values, nan_ok=True)
        assert channel.rounding == pytest.approx(0.0, abs=1e-12)


def test_text_is_compressed() -> None:
    text = "three " * 1000
    assert len(pack_text(text)) < 200
    assert gzip.decompress(base64.b64decode(pack_text(text))).decode() == text
