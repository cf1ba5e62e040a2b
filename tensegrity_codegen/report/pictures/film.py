"""Film files from a sequence of pictures, each held for a number of frames."""

import shutil
import subprocess
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from itertools import chain
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.system.errors import MissingExtraError, OutputError

Image = NDArray[np.uint8]

# A GIF counts in hundredths of a second, and players slow down what is held for less than two.
GIF_FASTEST = 50.0
# Palette entries from here on are paper.
NEARLY_WHITE = 246


def find_ffmpeg(target: Path) -> str:
    """Return the path of the program ffmpeg; MissingExtraError, which proposes a GIF, if there is none."""
    program = shutil.which("ffmpeg")
    if program is None:
        raise MissingExtraError(
            "films of kind '.mp4' need the program 'ffmpeg', which is not on PATH",
            where=str(target),
            hint=f"write {target.with_suffix('.gif').name!r} instead, or install ffmpeg",
        )
    return program


def write_gif(path: Path, images: Iterator[Image], counts: Sequence[int], fps: float) -> None:
    """Write pictures (height, width, 3), held for `counts` frames of 1/fps s each, as an endless GIF.

    All share the palette of the first picture, which holds the whole scale of tensions, so nothing flickers.
    """
    from PIL import Image as Pillow

    first = Pillow.fromarray(next(images))
    palette = first.quantize(colors=256, method=Pillow.Quantize.MEDIANCUT, dither=Pillow.Dither.NONE)

    # Averaging must not tint the paper.
    colors = np.array(palette.getpalette()).reshape(-1, 3)
    colors[colors.min(axis=1) >= NEARLY_WHITE] = 255
    palette.putpalette(colors.ravel().tolist())

    def reduce(image: Any) -> Any:
        return image.quantize(palette=palette, dither=Pillow.Dither.NONE)

    # Rounding the ends, not the lengths, keeps the film in time.
    ends = np.rint(np.concatenate([[0], np.cumsum(counts)]) * 100.0 / fps).astype(int)
    with path.open("wb") as file:
        reduce(first).save(
            file,
            format="GIF",
            save_all=True,
            append_images=(reduce(Pillow.fromarray(image)) for image in images),
            duration=(10 * np.diff(ends)).tolist(),
            loop=0,
            optimize=False,
        )


def write_mp4(ffmpeg: str, path: Path, images: Iterator[Image], counts: Sequence[int], fps: float) -> None:
    """Write pictures (height, width, 3) of even size, held for `counts` frames each, as H.264 in MP4.

    Raises OutputError with what ffmpeg wrote if it fails.
    """
    first = next(images)
    height, width = first.shape[:2]
    command = [
        ffmpeg, "-hide_banner", "-loglevel", "error", "-y",
        "-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{width}x{height}", "-r", f"{fps:.6f}", "-i", "-",
        "-an", "-c:v", "libx264", "-pix_fmt", "yuv420p", "-crf", "18", "-movflags", "+faststart",
        "-f", "mp4", str(path.absolute()),
    ]  # fmt: skip
    with tempfile.TemporaryFile() as log:
        code = _feed(command, chain([first], images), counts, log)
        if code != 0:
            log.seek(0)
            said = log.read().decode(errors="replace").strip()[-1000:]
            raise OutputError(
                f"ffmpeg failed with code {code}: {said}", where=path.suffix, hint="write a .gif instead"
            )


def _feed(command: Sequence[str], images: Iterable[Image], counts: Sequence[int], log: IO[bytes]) -> int:
    """Run `command` on the frames, its messages into `log`, and return its exit code."""
    process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=log)
    # A program that fails closes its end of the pipe; its exit code says so.
    with suppress(BrokenPipeError), process:
        for image, count in zip(images, counts, strict=True):
            frame = image.tobytes()
            for _ in range(count):
                process.stdin.write(frame)  # type: ignore[union-attr]
    return process.wait()
