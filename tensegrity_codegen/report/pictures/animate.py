"""Films of a simulated motion: GIF through Pillow, MP4 through the program ffmpeg."""

import shutil
import subprocess
import tempfile
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from itertools import chain
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.report.pictures.canvas import add_clock, add_heading, check_suffix, new_figure
from tensegrity_codegen.report.pictures.panel import (
    Panel,
    Setting,
    add_color_bar,
    add_key,
    describe_size,
    fit_size,
    set_up,
)
from tensegrity_codegen.report.pictures.shown import show_motion
from tensegrity_codegen.report.pictures.view import PictureChoices, check_trajectory
from tensegrity_codegen.runtime.trajectory.trajectory import Trajectory
from tensegrity_codegen.structure.bodies import BodySystem
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.arrays import FloatArray, IntArray
from tensegrity_codegen.system.errors import InvalidValueError, MissingExtraError, OutputError
from tensegrity_codegen.system.extras import import_extra
from tensegrity_codegen.system.files import replaced

Image = NDArray[np.uint8]

# A GIF counts in hundredths of a second, and players slow down frames that are held for less than two.
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

    opening = Pillow.fromarray(next(images))
    palette = opening.quantize(colors=256, method=Pillow.Quantize.MEDIANCUT, dither=Pillow.Dither.NONE)

    # Averaging must not tint the paper.
    colors = np.array(palette.getpalette()).reshape(-1, 3)
    colors[colors.min(axis=1) >= NEARLY_WHITE] = 255
    palette.putpalette(colors.ravel().tolist())

    def reduce(image: Any) -> Any:
        return image.quantize(palette=palette, dither=Pillow.Dither.NONE)

    # Rounding the ends, not the lengths, keeps the film in time.
    ends = np.rint(np.concatenate([[0], np.cumsum(counts)]) * 100.0 / fps).astype(int)
    with path.open("wb") as file:
        reduce(opening).save(
            file,
            format="GIF",
            save_all=True,
            append_images=(reduce(Pillow.fromarray(image)) for image in images),
            duration=(10 * np.diff(ends)).tolist(),
            loop=0,
            optimize=False,
        )


def write_mp4(ffmpeg: str, path: Path, images: Iterator[Image], counts: Sequence[int], fps: float) -> None:
    """Write pictures (height, width, 3) of even size, held for `counts` frames each, as H.264 in MP4."""
    opening = next(images)
    height, width = opening.shape[:2]
    command = [
        ffmpeg, "-hide_banner", "-loglevel", "error", "-y",
        "-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{width}x{height}", "-r", f"{fps:.6f}", "-i", "-",
        "-an", "-c:v", "libx264", "-pix_fmt", "yuv420p", "-crf", "18", "-movflags", "+faststart",
        "-f", "mp4", str(path.absolute()),
    ]  # fmt: skip
    with tempfile.TemporaryFile() as log:
        code = _feed(command, chain([opening], images), counts, log)
        if code != 0:
            log.seek(0)
            message = log.read().decode(errors="replace").strip()[-1000:]
            raise OutputError(
                f"ffmpeg failed with code {code}: {message}", where=path.suffix, hint="write a .gif instead"
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


Progress = Callable[[float], None]

FILM_SUFFIXES = (".gif", ".mp4")

# Frames of a film at most: two minutes at the usual 25 a second.
MAX_FRAMES = 3000
FASTEST = {".gif": GIF_FASTEST, ".mp4": 120.0}
FILM_DPI = 100
# Square inches of the panel.
AREA = 20.0
DEFAULT = PictureChoices()


def write_animation(
    structure: Structure,
    trajectory: Trajectory,
    path: str | Path,
    *,
    fps: float = 25,
    slow_down: float = 1.0,
    progress: Progress | None = None,
    choices: PictureChoices = DEFAULT,
    subject: Structure | BodySystem | None = None,
    overwrite: bool = False,
) -> Path:
    """Write a motion as a film (.gif or .mp4) and return its path; each frame shows the nearest sample."""
    target = Path(path)
    suffix = check_suffix(target, FILM_SUFFIXES)
    fastest = FASTEST[suffix]
    if not 0 < fps <= fastest:
        raise InvalidValueError(
            "fps is out of range", where="fps", given=fps, allowed=f"0 < fps <= {fastest:g}"
        )
    if not 0 < slow_down < np.inf:
        raise InvalidValueError(
            "slow_down is out of range", where="slow_down", given=slow_down, allowed="a finite number > 0",
            hint="10 shows a simulated second in ten",
        )  # fmt: skip
    # The coder of this kind of film wants even numbers
    if suffix == ".mp4" and choices.size is not None and any(side % 2 for side in choices.size):
        raise InvalidValueError(
            "films of kind '.mp4' have an even width and height", where="size",
            given="x".join(map(str, choices.size)), allowed="even numbers of pixels",
            hint="x".join(str(side + side % 2) for side in choices.size) + ", or a .gif",
        )  # fmt: skip
    check_trajectory(structure, trajectory)
    frames = find_frames(trajectory.time, fps, slow_down)
    ffmpeg = find_ffmpeg(target) if suffix == ".mp4" else None
    import_extra("matplotlib")
    if ffmpeg is None:
        import_extra("PIL.Image")
    setting = set_up(show_motion(structure, trajectory, subject), choices)
    with replaced(target, overwrite=overwrite) as temporary:
        # An unwritable folder shows now, not after the drawing.
        temporary.touch(exist_ok=False)
        # The samples to draw, and for how many frames each is held
        starts = np.flatnonzero(np.diff(frames, prepend=-1))
        shots, counts = frames[starts], np.diff(starts, append=len(frames)).tolist()
        images = _paint_samples(_Stage(setting, trajectory), shots, progress)
        if ffmpeg is None:
            write_gif(temporary, images, counts, fps)
        else:
            write_mp4(ffmpeg, temporary, images, counts, fps)
    return target


def find_frames(time: FloatArray, fps: float, slow_down: float) -> IntArray:
    """Return the sample that each frame shows: the nearest to k / (fps slow_down), at last the last one.

    time (n_t,) [s], increasing.
    """
    elapsed = time - time[0]
    count = np.floor(float(elapsed[-1]) * slow_down * fps * (1 + 1e-12) + 1e-9) + 1
    if count > MAX_FRAMES:
        fits = (MAX_FRAMES - 1) / (float(elapsed[-1]) * fps)
        digit = 10.0 ** (np.floor(np.log10(fits)) - 1)
        raise InvalidValueError(
            f"the film would have {count:.6g} frames",
            where="slow_down",
            given=slow_down,
            allowed=f"at most {MAX_FRAMES} frames",
            hint=f"slow_down {np.floor(fits / digit) * digit:.2g}, or fewer frames a second",
        )
    moments = np.arange(int(count)) / (fps * slow_down)
    after = np.clip(np.searchsorted(elapsed, moments), 1, max(len(elapsed) - 1, 1))
    after = np.minimum(after, len(elapsed) - 1)
    before = np.maximum(after - 1, 0)
    nearest = np.where(moments - elapsed[before] <= elapsed[after] - moments, before, after)
    end = len(elapsed) - 1
    if nearest[-1] != end:
        nearest = np.append(nearest, end)
    chosen: IntArray = nearest.astype(np.int64)
    return chosen


class _Stage:
    """The figure of a film: resting parts are painted once, the others anew for each sample."""

    def __init__(self, setting: Setting, trajectory: Trajectory) -> None:
        self._trajectory = trajectory
        structure = setting.shown.structure
        width, height, dpi = fit_size(setting, area=AREA, dpi=FILM_DPI)
        # Video coders want even numbers of pixels; the canvas drops fractions of a pixel.
        step = 2 if setting.choices.size is None else 1
        width, height = ((step * round(dpi * side / step) + 1e-6) / dpi for side in (width, height))
        self._figure = new_figure(width, height, dpi)
        self._panel = Panel(self._figure.add_subplot(), setting, (width - 1.6, height - 1.6))
        if self._panel.drawing.mappable is not None:
            add_color_bar(self._figure, self._panel.axes, self._panel.drawing.mappable, **setting.scale)
        tension = trajectory.member_tension[:, structure.tension_only]
        add_key(self._figure, setting, slack=bool(np.any(tension <= 0)))
        add_heading(self._figure, structure.name, describe_size(structure, setting.shown.parts))
        self._clock = add_clock(self._figure)
        self._digits = _clock_digits(trajectory.time)
        # In the order in which a whole figure paints them.
        self._changing = (*sorted(self._panel.artists, key=lambda artist: float(artist.zorder)), self._clock)
        self._canvas, self._empty = self._paint_still()

    def _paint_still(self) -> tuple[Any, Any]:
        """Lay the figure out around the first sample; return its Agg canvas and the still pixels."""
        for artist in self._changing:
            artist.set_animated(not self._panel.is_moving)
        self._panel.show(0)
        canvas: Any = self._figure.canvas
        canvas.draw()
        self._figure.set_layout_engine("none")
        return canvas, canvas.copy_from_bbox(self._figure.bbox)

    def paint(self, sample: int) -> Image:
        """Return the picture of a sample, (height, width, 3) bytes."""
        self._panel.show(sample)
        self._clock.set_text(f"t = {self._trajectory.time[sample]:.{self._digits}f} s")
        if self._panel.is_moving:
            self._canvas.draw()
        else:
            self._canvas.restore_region(self._empty)
            for artist in self._changing:
                self._figure.draw_artist(artist)
        return np.array(self._canvas.buffer_rgba(), dtype=np.uint8)[..., :3]


def _paint_samples(stage: _Stage, samples: IntArray, progress: Progress | None) -> Iterator[Image]:
    """Yield the picture of each of the samples."""
    for done, sample in enumerate(samples, start=1):
        yield stage.paint(int(sample))
        if progress is not None:
            progress(done / len(samples))


def _clock_digits(time: FloatArray) -> int:
    """Return how many decimals tell the samples apart."""
    if len(time) < 2:
        return 3
    step = float(np.min(np.diff(time)))
    return int(np.clip(np.ceil(-np.log10(step)), 0, 9)) if step > 0 else 3
