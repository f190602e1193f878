"""Cameras as sensors: pictures of OpenCV or Micro-Manager, and the centroids of particles in them.

A picture becomes centroids in four steps: the background is taken away, a threshold separates the
particles, connected pixels are one particle (or several that touch, if the area says so), and each
particle's centroid is weighted by its brightness. Points are pixels (x, y) = (column, row), and the
middle of the first pixel is (0, 0). OpenCV does the work (extra ``opencv``).
"""

from __future__ import annotations

import dataclasses
import os
import re
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from shoal.core.checks import check_array, check_choice, check_number, check_text
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError, MissingExtraError, RigError, describe_error
from shoal.rigs.rig import Frame

Points = NDArray[np.float64]
Picture = NDArray[Any]  # (height, width), one number a pixel

CAMERAS = ("opencv", "pymmcore")
CONTRAST = 8  # brightness (of 255) over the ground, below which a picture shows nothing
OUTSTANDING = 6.0  # standard deviations of the noise over the ground, with the same meaning
SAMPLE = 2**17  # pixels that show the usual brightness and the noise
LARGEST = 0.1  # share of the picture that a particle may cover
SINGLE = 1.5  # area, in areas of one particle, from which on a blob is more than one
SIMILAR = 0.35  # spread of the areas, as a share, up to which the usual area is that of a particle
OPENING = 30.0  # seconds until the first picture
FIRST = 10  # pictures that show whether two pictures of the camera may be equal


@dataclass(frozen=True)
class Vision:
    """How particles are found in a picture.

    Parameters
    ----------
    background : str
        "none", a number of pictures whose median is taken away (of the first ones, in which
        particles must move), or a picture file of the same size.
    threshold : str
        "auto" (half way from the usual brightness to that of the brightest or darkest spot), "otsu"
        (for pictures that are full of particles), or a number in the unit of the picture (0 to 255 for 8 bits): the brightness that
        separates particles; with a background, their least difference from it.
    particles : str
        "bright", "dark", or "auto": what differs more from the usual brightness; with a stated
        threshold, what covers less of the picture.
    min_area, max_area : float
        Smallest and largest area of a blob in pixels. Others are no particles. Without a largest
        area, a blob of more than a tenth of the picture is an error.
    area : float
        Area of one particle in pixels: a blob of twice this area is two particles that touch. 0
        takes the median of all blobs, if these are about equal; inf never divides a blob.
    most : int
        Largest number of particles. More are an error: the threshold is wrong.
    stale : float
        Time without a new picture, in seconds, after which the camera counts as frozen.

    Raises
    ------
    InvalidInputError, UnknownNameError
    """

    background: str = "none"
    threshold: str = "auto"
    particles: str = "auto"
    min_area: float = 4.0
    max_area: float = float("inf")
    area: float = 0.0
    most: int = 5000
    stale: float = 5.0

    def __post_init__(self) -> None:
        check_choice(self.particles, what="particles", choices=("auto", "bright", "dark"))
        if self.threshold not in ("auto", "otsu"):
            check_number(_number("threshold", self.threshold), what="threshold", above=0)
        for name in ("min_area", "max_area", "area"):
            if getattr(self, name) != float("inf"):
                check_number(getattr(self, name), what=name.replace("_", "-"), least=0)
        check_number(self.most, what="most", least=1)
        check_number(self.stale, what="stale", above=0)

    @classmethod
    def of(cls, **texts: str) -> Vision:
        """Return the options that texts give, such as ``min_area="20"``."""
        values: dict[str, Any] = {}
        for name, text in texts.items():
            check_choice(
                name.replace("_", "-"),
                what="camera",
                choices=[field.name.replace("_", "-") for field in dataclasses.fields(cls)],
            )
            plain = name in ("background", "threshold", "particles")
            values[name] = text if plain else _number(name, text)
        return cls(**values)


def _number(name: str, text: object) -> float:
    try:
        return float(text)  # type: ignore[arg-type]
    except (TypeError, ValueError):
        raise InvalidInputError(
            f"{name.replace('_', '-')}: expected a number, got {str(text)[:60]!r}"
        ) from None


def load_opencv() -> Any:
    """Return the module cv2, which prints no messages of its own.

    Raises
    ------
    MissingExtraError
    """
    # OpenCV and its decoder print their own messages; ours say what is wrong
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
    try:
        import cv2
    except ImportError:
        raise MissingExtraError("a camera needs OpenCV: pip install 'shoal[opencv]'") from None
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    return cv2


def grey(picture: Picture) -> Picture:
    """Return a picture with one number a pixel."""
    picture = check_array(picture, expected="picture: expected numbers")
    if picture.ndim not in (2, 3):
        raise InvalidInputError(
            f"picture: expected shape (height, width) or (height, width, 3), got {picture.shape}"
        )
    if picture.ndim == 2:
        return picture
    cv2 = load_opencv()
    return np.asarray(cv2.cvtColor(np.ascontiguousarray(picture[..., :3]), cv2.COLOR_BGR2GRAY))


class Detector:
    """Finds the centroids of particles in pictures.

    Parameters
    ----------
    vision : Vision

    Raises
    ------
    InvalidInputError, MissingExtraError
    """

    def __init__(self, vision: Vision | None = None) -> None:
        self.vision = vision or Vision()
        self._cv = load_opencv()
        self.background: Picture | None = None
        kind = self.vision.background
        self.waits_for = int(kind) if kind.isdigit() else 0
        if kind != "none" and not kind.isdigit():
            read = (
                self._cv.imread(kind, self._cv.IMREAD_GRAYSCALE) if Path(kind).is_file() else None
            )
            if read is None:
                raise InvalidInputError(
                    "background: expected none, a number of pictures or a picture file, got"
                    f" {kind!r}"
                )
            self.background = read.astype(np.float32)

    def learn(self, pictures: list[Picture]) -> None:
        """Take the median of pictures as the background."""
        self.background = np.median(np.stack(pictures), axis=0).astype(np.float32)

    def find(self, picture: Picture) -> Points:
        """Return the centroids (x, y) of the particles (float64, shape (n, 2)).

        Raises
        ------
        RigError
            Raised if the picture shows nothing at all, or more than the largest number of
            particles.
        """
        cv2, vision = self._cv, self.vision
        bright = grey(picture).astype(np.float32)
        signal = bright if self.background is None else self._difference_to_background(bright)
        threshold, side = self._threshold(signal, float(bright.max()))
        if not side:
            if self.background is not None:
                return np.empty((0, 2))  # as empty as the background
            raise RigError(
                "camera: expected a picture with particles, got one in which nothing stands out of"
                f" the noise (brightness {bright.min():.0f} to {bright.max():.0f}): the lamp is off,"
                " or the lens is covered"
            )
        over = side * (signal - threshold)
        mask = over > 0
        count, labels, stats, _ = cv2.connectedComponentsWithStats(
            mask.astype(np.uint8), connectivity=8
        )
        areas = stats[:, cv2.CC_STAT_AREA].astype(float)
        good = (areas >= vision.min_area) & (areas <= vision.max_area)
        good[0] = False  # the background
        if (areas[good] > LARGEST * mask.size).any() and vision.max_area == float("inf"):
            raise RigError(
                f"camera: expected particles, got a blob of {100 * areas[good].max() / mask.size:.0f} %"
                " of the picture, which may be the vessel: state threshold, particles, background or"
                " max-area"
            )
        if good.sum() > vision.most:
            raise RigError(
                f"camera: expected at most {vision.most:g} particles, got {int(good.sum())}: choose"
                " another threshold or a larger min-area"
            )
        rows, columns = np.nonzero(mask)
        names, weights = labels[rows, columns], over[rows, columns]
        total = np.maximum(np.bincount(names, weights, count), 1e-9)
        x = np.bincount(names, weights * columns, count) / total
        y = np.bincount(names, weights * rows, count) / total
        several = good & self._are_several(areas, good)
        divided = [
            self._divide(labels == label, areas[label], areas[good])
            for label in np.flatnonzero(several).tolist()
        ]
        single = np.column_stack([x, y])[good & ~several]
        return np.vstack([single, *divided]).astype(np.float64)

    def _threshold(self, signal: NDArray[np.float32], brightest: float) -> tuple[float, int]:
        """Return the brightness that separates particles, and 1 for bright or -1 for dark ones, or 0
        if nothing stands out of the noise.
        """
        cv2, vision = self._cv, self.vision
        smooth = cv2.medianBlur(signal, 3)  # single pixels are no particles
        step = max(1, round((signal.size / SAMPLE) ** 0.5))
        sample = signal[::step, ::step]
        ground = float(np.median(sample))
        noise = 1.4826 * float(np.median(np.abs(sample - smooth[::step, ::step])))
        ends = {1: float(smooth.max()), -1: float(smooth.min())}
        sides = {"bright": (1,), "dark": (-1,), "auto": (1, -1)}[vision.particles]
        if self.background is not None:
            sides = (1,)  # what is darker than the background is above 0 as well
        side = max(sides, key=lambda side: abs(ends[side] - ground))
        least = max(CONTRAST * max(brightest, 255.0) / 255, OUTSTANDING * noise)
        if (ends[side] - ground) * side < least:
            return 0.0, 0
        if vision.threshold == "auto":
            return (ground + ends[side]) / 2, side
        if vision.threshold == "otsu":
            lowest, highest = float(signal.min()), float(signal.max())
            scaled = ((signal - lowest) * (255 / (highest - lowest))).astype(np.uint8)
            level, _ = cv2.threshold(scaled, 0, 255, cv2.THRESH_BINARY | cv2.THRESH_OTSU)
            return lowest + (level + 0.5) * (highest - lowest) / 255, side
        threshold = float(vision.threshold)
        if self.background is None and vision.particles == "auto":
            side = 1 if (signal > threshold).mean() <= 0.5 else -1
        return threshold, side

    def _difference_to_background(self, bright: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return how far each pixel differs from the background, particles above 0."""
        assert self.background is not None
        if self.background.shape != bright.shape:
            raise InvalidInputError(
                f"background: expected a picture of {bright.shape[1]}x{bright.shape[0]} pixels, got"
                f" {self.background.shape[1]}x{self.background.shape[0]}"
            )
        over = bright - self.background
        if self.vision.particles == "auto":
            return np.abs(over)
        return np.maximum(over if self.vision.particles == "bright" else -over, 0)

    def _single_area(self, areas: NDArray[np.float64]) -> float:
        """Return the area of one particle, or inf if nothing tells it."""
        if self.vision.area:
            return self.vision.area
        low, middle, high = np.quantile(areas, [0.25, 0.5, 0.75])
        return float(middle) if len(areas) >= 4 and high - low <= SIMILAR * middle else np.inf

    def _are_several(
        self, areas: NDArray[np.float64], good: NDArray[np.bool_]
    ) -> NDArray[np.bool_]:
        single_area = self._single_area(areas[good]) if good.any() else np.inf
        return np.asarray(areas >= SINGLE * single_area)

    def _divide(self, blob: NDArray[np.bool_], area: float, areas: NDArray[np.float64]) -> Points:
        """Return the middles of the particles that touch in one blob (k-means of its pixels)."""
        parts = max(2, round(area / self._single_area(areas)))
        rows, columns = np.nonzero(blob)
        pixels = np.column_stack([columns, rows]).astype(np.float32)
        ends = (self._cv.TERM_CRITERIA_EPS + self._cv.TERM_CRITERIA_MAX_ITER, 30, 0.01)
        self._cv.setRNGSeed(1)
        *_, middles = self._cv.kmeans(pixels, parts, None, ends, 3, self._cv.KMEANS_PP_CENTERS)
        return np.asarray(middles, dtype=np.float64)


class Source(Protocol):
    """Where pictures come from. One thread calls all methods."""

    def open(self) -> None:
        """Connect to the camera."""

    def grab(self) -> Picture | None:
        """Return the next picture, or None if there is none yet. Raise RigError after the last."""

    def close(self) -> None:
        """Release the camera."""


class OpenCVSource:
    """Pictures that OpenCV reads: a camera by its number, a video file or the address of a stream.
    A file is played at its own speed.

    Parameters
    ----------
    name : str

    Raises
    ------
    InvalidInputError
        Raised if the name is none of these.
    """

    def __init__(self, name: str) -> None:
        self.name, self._cv = name, load_opencv()
        self._between = self._due = 0.0
        if "://" not in name and not name.isdigit() and not Path(name).is_file():
            raise InvalidInputError(
                "sensor opencv: expected the number of a camera, a video file or an address, got"
                f" {name[:80]!r}"
            )

    def open(self) -> None:
        """Open the camera, the file or the stream."""
        self._capture = self._cv.VideoCapture(int(self.name) if self.name.isdigit() else self.name)
        if not self._capture.isOpened():
            raise RigError(f"sensor opencv: cannot open {self.name!r}")
        if Path(self.name).is_file():
            rate = self._capture.get(self._cv.CAP_PROP_FPS)
            self._between = 1 / rate if 0 < rate < 1e4 else 0.04
        self._due = time.monotonic()

    def grab(self) -> Picture | None:
        """Return the next picture."""
        if (early := self._due - time.monotonic()) > 0:
            time.sleep(early)
        self._due += self._between
        good, picture = self._capture.read()
        if not good:
            raise RigError(f"sensor opencv: {self.name!r} has ended")
        return np.asarray(picture)

    def close(self) -> None:
        """Release the camera."""
        self._capture.release()


class MicroManagerSource:
    """Pictures of the camera of a Micro-Manager core (pymmcore or pymmcore-plus).

    Parameters
    ----------
    config : str or core
        A configuration file of Micro-Manager, or a core whose camera is set up already. Lines
        ``#py ...`` of a file load Python cameras; these need pymmcore-plus.
    """

    def __init__(self, config: Any) -> None:
        self._made = isinstance(config, str)
        self.core = _core_of(config) if isinstance(config, str) else config

    def open(self) -> None:
        """Let the camera take pictures continuously."""
        if not self.core.getCameraDevice():
            raise RigError("sensor pymmcore: expected a configuration with a camera, got none")
        self.core.startContinuousSequenceAcquisition(0)

    def grab(self) -> Picture | None:
        """Return the newest picture that was not returned before."""
        core, picture = self.core, None
        while core.getRemainingImageCount() > 0:
            picture = core.popNextImage()
        if picture is None:
            if not core.isSequenceRunning():
                raise RigError("sensor pymmcore: the camera has stopped")
            time.sleep(0.001)
            return None
        return np.array(picture)

    def close(self) -> None:
        """Stop the camera, and unload what was loaded."""
        if self.core.isSequenceRunning():
            self.core.stopSequenceAcquisition()
        if self._made:
            self.core.unloadAllDevices()
            # A core tells its events in a thread of its own, and aborts the program if Python ends
            # meanwhile. pymmcore-plus hides the method that ends the thread.
            base = next(cls for cls in type(self.core).__mro__ if cls.__name__ == "CMMCore")
            base.registerCallback(self.core, None)  # type: ignore[attr-defined]


def _core_of(config: str) -> Any:
    path = Path(config)
    if not path.is_file():
        raise InvalidInputError(
            f"sensor pymmcore: expected a configuration file of Micro-Manager, got {config[:80]!r}"
        )
    python = any(
        line.startswith("#py ") for line in path.read_text("utf-8", "replace").splitlines()
    )
    folders: list[str] = []
    try:
        if python:
            from pymmcore_plus.experimental.unicore import UniMMCore

            core: Any = UniMMCore()
        else:
            from pymmcore import CMMCore

            core = CMMCore()
    except ImportError:
        raise MissingExtraError(
            "Python cameras of Micro-Manager need pymmcore-plus: pip install pymmcore-plus"
            if python
            else "a camera of Micro-Manager needs pymmcore: pip install 'shoal[micromanager]'"
        ) from None
    if os.environ.get("MICROMANAGER_PATH"):
        folders.append(os.environ["MICROMANAGER_PATH"])
    else:
        try:
            import mm_test_adapters

            folders.append(str(mm_test_adapters.device_adapter_path()))
        except ImportError:
            pass
    if folders:
        core.setDeviceAdapterSearchPaths(folders)
    try:
        core.loadSystemConfiguration(str(path.resolve()))
    except Exception as error:
        raise RigError(
            f"sensor pymmcore: {path}: {describe_error(error)} (the environment variable"
            " MICROMANAGER_PATH names the folder of the device adapters)"
        ) from None
    return core


class CameraSensor:
    """A sensor that finds particles in the pictures of a camera. A thread of its own takes each
    picture when it arrives, so that `observe` always returns the newest one.

    Parameters
    ----------
    name : str
    source : Source
    vision : Vision, optional

    Raises
    ------
    RigError
        Raised if no picture arrives.
    """

    def __init__(self, name: str, source: Source, vision: Vision | None = None) -> None:
        self.name, self.vision = name, vision or Vision()
        self.detector = Detector(self.vision)
        self._source, self._changed = source, threading.Condition()
        self._picture: Picture | None = None
        self._arrived, self._number = 0.0, 0
        self._changed_at = time.monotonic()  # when a picture differed from the one before
        self._equal, self._noisy = 0, True
        self._failure: BaseException | None = None
        self._closing = threading.Event()
        self._found: Frame | None = None
        self._thread = threading.Thread(target=self._read, name=f"camera {name}", daemon=True)
        self._thread.start()
        try:
            self._wait(lambda: self._number > 0, OPENING)
            if self.detector.waits_for:
                self.detector.learn(self._take_pictures(self.detector.waits_for))
        except BaseException:
            self.close()
            raise

    def _read(self) -> None:
        try:
            self._source.open()
            try:
                while not self._closing.is_set():
                    picture = self._source.grab()
                    if picture is not None:
                        self._take(picture, time.monotonic())
            finally:
                self._source.close()
        except BaseException as error:  # told by `observe`
            with self._changed:
                self._failure = error
                self._changed.notify_all()

    def _take(self, picture: Picture, now: float) -> None:
        with self._changed:
            same = self._picture is not None and np.array_equal(picture, self._picture)
            self._number += 1
            if same and self._number <= FIRST:
                self._noisy = False  # pictures without noise: equal ones may be new
            if not same:
                self._changed_at = now
            self._picture, self._arrived = picture, now
            self._changed.notify_all()

    def _wait(self, done: Callable[[], bool], seconds: float) -> None:
        with self._changed:
            self._changed.wait_for(lambda: done() or self._failure is not None, seconds)
            if self._failure is not None and not done():
                self._raise_failure()
            if not done():
                raise RigError(f"sensor {self.name}: no picture arrived for {seconds:g} s")

    def _raise_failure(self) -> None:
        error = self._failure
        if isinstance(error, RigError | InvalidInputError):
            raise type(error)(str(error)) from None
        raise RigError(f"sensor {self.name}: {describe_error(error)}")  # type: ignore[arg-type]

    def _take_pictures(self, count: int) -> list[Picture]:
        pictures = []
        for _ in range(count):
            pictures.append(grey(self.picture()))
            last = self._number
            self._wait(lambda last=last: self._number > last, self.vision.stale)  # type: ignore[misc]
        return pictures

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the pictures in pixels."""
        height, width = self.picture().shape[:2]
        return width, height

    def picture(self) -> Picture:
        """Return the newest picture, as the camera gave it."""
        assert self._picture is not None
        return self._picture

    def observe(self) -> Frame:
        """Return the centroids in the newest picture, in pixels (x, y). Rows keep the order of the
        picture before, as far as the same particles are seen.

        Raises
        ------
        RigError
            Raised if the camera has failed, shows the same picture again and again, or sends none.
        """
        with self._changed:
            picture, arrived, number = self._picture, self._arrived, self._number
            failure = self._failure
        assert picture is not None
        if self._found is not None and self._found.number == number:
            if failure is not None:
                self._raise_failure()
            if time.monotonic() - arrived > self.vision.stale:
                raise RigError(f"sensor {self.name}: no picture for {self.vision.stale:g} s")
            return self._found
        if self._noisy and number > FIRST and arrived - self._changed_at > self.vision.stale:
            raise RigError(
                f"sensor {self.name}: the same picture again and again for {self.vision.stale:g} s:"
                " the camera is frozen"
            )
        points = self.detector.find(picture)
        if self._found is not None:
            points = _in_order(self._found.points, points)
        self._found = Frame(points, arrived, number)
        return self._found

    def close(self) -> None:
        """Release the camera."""
        self._closing.set()
        if self._thread is not threading.current_thread():
            self._thread.join(2.0)


def _in_order(before: Points, after: Points) -> Points:
    """Return points in the order of the nearest points before (Hungarian method), new ones last."""
    from scipy.optimize import linear_sum_assignment
    from scipy.spatial.distance import cdist

    if not len(before) or not len(after):
        return after
    first, second = linear_sum_assignment(cdist(before, after))
    order = second[np.argsort(first)]
    return np.vstack([after[order], np.delete(after, order, axis=0)])


def open_camera(spec: str) -> CameraSensor:
    """Open the camera that a text names.

    Parameters
    ----------
    spec : str
        ``opencv:INDEX|FILE|ADDRESS`` or ``pymmcore:CONFIG``, with options of `Vision` after commas,
        as in ``opencv:0,threshold=40,min-area=20``.

    Raises
    ------
    InvalidInputError, UnknownNameError, MissingExtraError, RigError
    """
    kind, _, settings = check_text(spec, what="camera").partition(":")
    name, *pairs = re.split(r",(?=[a-z-]+=)", settings)
    options: dict[str, str] = {}
    for pair in pairs:
        option, _, value = pair.partition("=")
        option = option.replace("-", "_")
        if option in options:
            raise InvalidInputError(f"sensor {kind}: expected each option once, got {option} twice")
        options[option] = value
    vision = Vision.of(**options)
    if not name:
        raise InvalidInputError(
            f"sensor: expected {kind}:"
            f"{'INDEX, FILE or ADDRESS' if kind == 'opencv' else 'CONFIG'}, got {spec!r}"
        )
    source: Source = OpenCVSource(name) if kind == "opencv" else MicroManagerSource(name)
    return CameraSensor(f"{kind}:{name}", source, vision)
