# SPDX-License-Identifier: Apache-2.0
"""Image-based reflectance fields: measure how a scene turns light into pixels, and relight it.

A reflectance field is the matrix T of B = T L, which turns a light map L into the image B of a scene. Estimate it from
photographs under known lights, then show the scene in any other light::

    import refield
    field = refield.estimate(light, observed)  # [N, h, w, 3] and [N, H, W, 3]
    image = field.relight(new_light)           # [H, W, 3]

Images are scene-linear RGB, float32, top row first; radiance is relative unless a calibration defines units. Light maps
are of one of three parameterisations: ``monitor``, ``lat_long`` or ``cube`` (docs/reference/conventions.md).

Errors are `InputError`, `FormatError`, `DeviceError` and `SolverError`, all derived from `Error`, with the text of the
command line; the first two are also `ValueError`. Notes, such as photographs that are left out, go to the logger
"refield". Long calls release the interpreter lock; Ctrl-C ends them with `KeyboardInterrupt`. Files are read in this
process: for files of unknown origin use the command line, which reads them in a process of their own.

A process that was forked after the first use of refield has none of its threads, and long calls raise `Error` there. Use
the start methods ``spawn`` or ``forkserver`` of multiprocessing.
"""
from __future__ import annotations

import json
import os
import pathlib
import tempfile
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple, Optional, Union

import numpy as np
import numpy.typing as npt

from . import _refield
from ._refield import DeviceError, Error, FormatError, InputError, SolverError

__all__ = [
    "estimate", "Field", "Relighter", "Kernel", "Session", "Frame", "compare", "Comparison", "ImageError", "evaluate",
    "Evaluation", "simulate", "precompute", "hdr_merge", "environment", "read_image", "write_exr", "dynamic",
    "Error", "InputError", "FormatError", "DeviceError", "SolverError",
]
__version__: str = _refield.version

Array = npt.NDArray[np.float32]
Path = Union[str, "os.PathLike[str]"]
#: Called with the stage, the work done and the total; or a tqdm bar.
Progress = Union[Callable[[str, int, int], object], Any, None]


def _floats(array: npt.ArrayLike, name: str) -> Array:
    """float32 as it is; float64 and float16 rounded or widened; uint16 and uint8 such that their largest value is 1."""
    given = np.asarray(array)
    if given.dtype == np.float32 and given.dtype.isnative:
        if given.flags.aligned and all(stride % 4 == 0 for stride in given.strides):
            return given
        return np.ascontiguousarray(given)
    if given.dtype.kind == "f":
        return given.astype(np.float32)
    if given.dtype in (np.dtype(np.uint16), np.dtype(np.uint8)):
        return np.multiply(given, np.float32(1.0 / np.iinfo(given.dtype).max), dtype=np.float32)
    raise InputError(f"{name}: has the type {given.dtype}; give float32, float16, float64, uint16 or uint8")


def _progress(progress: Progress) -> Optional[Callable[[str, int, int], object]]:
    """tqdm bars are no functions of a stage."""
    if progress is None or not (hasattr(progress, "set_description") and hasattr(progress, "refresh")):
        return progress
    bar: Any = progress

    def show(stage: str, done: int, total: int) -> None:
        bar.set_description(stage, refresh=False)
        bar.total, bar.n = total, done
        bar.refresh()

    return show


def _texts(monitor: Union[str, Sequence[str], None]) -> list[str]:
    return [] if monitor is None else [monitor] if isinstance(monitor, str) else list(monitor)


def _is_path(value: object) -> bool:
    return isinstance(value, (str, os.PathLike))


def read_image(path: Path) -> Array:
    """Read an image file as scene-linear RGB.

    Parameters
    ----------
    path : path
        OpenEXR, HDR or PFM (values as stored), PNG or JPEG (decoded from sRGB), TIFF.

    Returns
    -------
    array [H, W, 3], float32

    Raises
    ------
    DeviceError, FormatError
        The file is missing, or is no image.
    """
    return _refield.read_image(path)


def write_exr(path: Path, image: npt.ArrayLike) -> None:
    """Write an image [H, W, 3] as OpenEXR with 32-bit floats. The file appears when it is complete."""
    _refield.write_exr(path, _floats(image, "image"))


class Kernel(NamedTuple):
    """One entry of a pixel's row of T."""

    kind: str  #: "box" or "hat" (bilinear)
    box: tuple[int, int, int, int]  #: x0, y0, x1, y1 of the light map, half-open, outside which it is zero
    weight: tuple[float, float, float]  #: R, G, B; multiplies the sum of texel values under the kernel
    energy_share: float  #: of the pixel's response to white light, 0 to 1


class Relighter:
    """Shows one field under one light after another; made by `Field.relighter`.

    It lays the field out for speed once. Calls from several threads take turns; for parallel work make one per thread.
    """

    def __init__(self, field: Field, precision: str = "fast") -> None:
        self._frames = _refield.Frames(field._native, precision)

    def relight(self, light: npt.ArrayLike, out: Optional[Array] = None) -> Array:
        """The scene under `light` [h, w, 3], as [H, W, 3]; written straight into `out` where it is given."""
        return self._frames.relight(_floats(light, "light"), out)

    def update(self, light: npt.ArrayLike, changed: tuple[int, int, int, int], out: Optional[Array] = None) -> Array:
        """The same after `light` changed inside a rectangle alone, in less time the less of it changed.

        Parameters
        ----------
        light : array [h, w, 3]
            The whole light map.
        changed : (x0, y0, x1, y1)
            Columns x0 to x1 - 1 and rows y0 to y1 - 1, outside which the light is that of the call before. The first
            call after `relight` computes the whole image.
        """
        return self._frames.update(_floats(light, "light"), changed, out)


class Field:
    """A reflectance field: the transport T of a scene, as estimated, simulated, precomputed or loaded.

    Methods may be called from several threads at a time. Fields can be pickled.
    """

    def __init__(self, native: _refield.Field) -> None:
        self._native = native

    @staticmethod
    def load(path: Path) -> Field:
        """Read a field (.rfield), packed or not.

        Raises
        ------
        DeviceError, FormatError
            The file is missing, of another kind or version, or damaged.
        """
        return Field(_refield.Field.load(path))

    def save(self, path: Path) -> None:
        """Write the field as one file (.rfield), which appears when it is complete."""
        self._native.save(path)

    @property
    def shape(self) -> tuple[int, int, int]:
        """Height, width and 3 of its images."""
        height, width, channels = self._native.shape
        return height, width, channels

    @property
    def light_shape(self) -> tuple[int, int, int]:
        """Height, width and 3 of its light maps."""
        height, width, channels = self._native.light_shape
        return height, width, channels

    @property
    def parameterisation(self) -> str:
        """Of its light maps: "monitor", "lat_long" or "cube"."""
        return self._native.parameterisation

    @property
    def monitors(self) -> list[str]:
        """Placements of the monitor, such as "520x320@600,yaw=90" (mm, degrees); empty where not known."""
        return self._native.monitors

    @property
    def bits(self) -> int:
        """Bits per weight: 32, or 8 or 16 of packed fields."""
        return self._native.bits

    @property
    def provenance(self) -> dict[str, Any]:
        """How the field was made: program, options, names of the photographs."""
        result: dict[str, Any] = json.loads(self._native.provenance)
        return result

    @property
    def predicted_error(self) -> Optional[Array]:
        """Relative RMSE [H, W] to be expected on new photographs, or None.

        It holds for photographs as noisy as those of the estimate, under light of their kind. 0 where nothing is known.
        """
        return self._native.predicted_error

    @property
    def noise(self) -> Optional[Array]:
        """The part [H, W] of `predicted_error` that is the photographs' own noise, or None."""
        return self._native.noise

    @property
    def training_error(self) -> Optional[Array]:
        """Relative RMSE [H, W] over the photographs that the field was estimated from, or None."""
        return self._native.training_error

    def relight(self, light: Union[npt.ArrayLike, Path], out: Optional[Array] = None, *, progress: Progress = None,
                threads: Optional[int] = None) -> Array:
        """The scene under new light, as `refield relight` gives it.

        Parameters
        ----------
        light : array [h, w, 3] or [N, h, w, 3], or path
            One light map or a batch, of `light_shape`; scene-linear.
        out : array, optional
            Receives the result: float32 in C order. Images are written into it without a copy.
        progress : callable or tqdm bar, optional
        threads : int, optional
            Limit of threads; None: all cores.

        Returns
        -------
        array [H, W, 3] or [N, H, W, 3], float32
            Up to 11 maps by the plain product. For more, the field is laid out for speed, which rounds weights to 16
            bits (relative RMSE below 1e-5). For single maps at a high rate use `relighter`. Fields of meshes are seen
            by their standard camera.

        Raises
        ------
        InputError
            The light or `out` has another shape.
        """
        array = read_image(light) if isinstance(light, (str, os.PathLike)) else _floats(light, "light")
        return self._native.relight(array, out, _progress(progress), threads)

    def relighter(self, precision: str = "fast") -> Relighter:
        """For many frames, also with partial updates of the light.

        Parameters
        ----------
        precision : {"fast", "fine"}
            Weights of 8 bits (relative RMSE about 4e-4) or 16 bits (below 1e-5).
        """
        return Relighter(self, precision)

    def transport(self, x: int, y: int) -> Array:
        """The reflectance function of a pixel: a row of T as an array [h, w, 3] over the light map.

        The pixel's value is the sum of its products with the light map, per channel.
        """
        return self._native.transport(x, y)

    def lit_by(self, u: int, v: int) -> Array:
        """A column of T: the image [H, W, 3] under light of 1 from the texel (u, v) alone."""
        return self._native.lit_by(u, v)

    def kernels(self, x: int, y: int) -> list[Kernel]:
        """What a pixel takes light from, most energy first (Matusik et al. 2004, equations 3 and 4)."""
        return [Kernel(*entry) for entry in self._native.kernels(x, y)]

    def pack(self, error: float = 1e-3) -> Field:
        """A copy with weights of 8 or 16 bits and without negligible kernels.

        Parameters
        ----------
        error : float
            Maximum relative RMSE of its images against those of the full field, 2e-5 or more.

        Returns
        -------
        Field
            What the packing cost is in ``provenance["pack"]``.

        Raises
        ------
        InputError
            The field is already packed, or weights of 16 bits cannot keep to `error`.
        """
        return Field(self._native.pack(error))

    def __reduce__(self) -> tuple[Callable[[bytes], Field], tuple[bytes]]:
        with tempfile.TemporaryDirectory() as folder:
            path = pathlib.Path(folder) / "field.rfield"
            self.save(path)
            return _from_bytes, (path.read_bytes(),)

    def _repr_png_(self) -> bytes:
        """The scene under uniform light, for notebooks."""
        return self._native.png()

    def __repr__(self) -> str:
        height, width, _ = self.shape
        rows, columns, _ = self.light_shape
        return f"<refield.Field {width}×{height}, {self.parameterisation} light {columns}×{rows}, {self.bits} bits>"


def _from_bytes(data: bytes) -> Field:
    with tempfile.TemporaryDirectory() as folder:
        path = pathlib.Path(folder) / "field.rfield"
        path.write_bytes(data)
        return Field.load(path)


class Frame:
    """One photograph of a session and the light that it was taken under."""

    def __init__(self, session: Session, index: int) -> None:
        self._session, self._index = session, index
        self.name: str  #: unique in the session
        self.role: str  #: "train", "test" (held out) or "reference" (repeated, for drift)
        self.kind: str  #: of light: "natural", "bar", "square", …
        self.light_path: pathlib.Path
        self.observed_path: pathlib.Path
        self.name, self.role, self.kind, self.light_path, self.observed_path = session._native.frame(index)

    def light(self) -> Array:
        """Read the light map, [h, w, 3]."""
        return self._session._native.light(self._index)

    def observed(self) -> Array:
        """Read the photograph, [H, W, 3]."""
        return self._session._native.observed(self._index)[0]

    def sigma(self) -> Optional[Array]:
        """Read the standard deviation of each sample, [H, W, 3], infinite where nothing was measured; None without."""
        return self._session._native.observed(self._index)[1]

    def __repr__(self) -> str:
        return f"<refield.Frame {self.name} ({self.role})>"


class Session:
    """A capture session on disk: photographs and the lights that they were taken under.

    Parameters
    ----------
    folder : path
        As written by `refield acquire`, `refield simulate` or `refield.simulate`. `len()` and iteration give its frames.

    Raises
    ------
    InputError, FormatError
        The manifest is broken, or a file is missing.
    """

    def __init__(self, folder: Path) -> None:
        self._native = _refield.Session.read(folder)

    @classmethod
    def _of(cls, native: _refield.Session) -> Session:
        session = cls.__new__(cls)
        session._native = native
        return session

    @classmethod
    def pairs(cls, light: Union[str, Sequence[Path]], observed: Union[str, Sequence[Path]],
              parameterisation: str = "monitor") -> Session:
        """A session of image files of other tools, all for training.

        Parameters
        ----------
        light, observed : pattern or sequence of paths
            Two patterns, such as "light/*.exr", are paired by the text that the wildcards match; sequences by place.
        parameterisation : {"monitor", "lat_long", "cube"}
        """
        if isinstance(light, str) and isinstance(observed, str):
            return cls._of(_refield.Session.globs(light, observed, parameterisation))
        if isinstance(light, str) or isinstance(observed, str):
            raise InputError("light and observed: give two patterns or two sequences of paths")
        return cls._of(_refield.Session.pairs(list(light), list(observed), parameterisation))

    def held_out(self, every: int) -> Session:
        """A copy in which every N-th training frame is held out for comparison, as by --hold-out."""
        return self._of(self._native.hold_out(every))

    def __len__(self) -> int:
        return len(self._native)

    def __getitem__(self, index: int) -> Frame:
        return Frame(self, index + len(self) if index < 0 else index)

    def __iter__(self) -> Iterator[Frame]:
        return (Frame(self, i) for i in range(len(self)))

    @property
    def train(self) -> list[Frame]:
        """Frames for estimation."""
        return [frame for frame in self if frame.role == "train"]

    @property
    def test(self) -> list[Frame]:
        """Held-out frames."""
        return [frame for frame in self if frame.role == "test"]

    @property
    def folder(self) -> pathlib.Path:
        """Empty for a session of pairs."""
        return self._native.folder

    @property
    def shape(self) -> tuple[int, int, int]:
        """Height, width and 3 of the photographs."""
        return self._native.shape

    @property
    def light_shape(self) -> tuple[int, int, int]:
        """Height, width and 3 of the light maps."""
        return self._native.light_shape

    @property
    def parameterisation(self) -> str:
        """Of the light maps: "monitor", "lat_long" or "cube"."""
        return self._native.parameterisation

    @property
    def mask(self) -> Optional[npt.NDArray[np.bool_]]:
        """Pixels that count, [H, W]; None: all."""
        return self._native.mask

    def __repr__(self) -> str:
        height, width, _ = self.shape
        return f"<refield.Session {self.folder} of {len(self)} photographs, {width}×{height}>"


def estimate(light: Union[npt.ArrayLike, str, Sequence[Path], Session],
             observed: Union[npt.ArrayLike, str, Sequence[Path], None] = None,
             sigma: Optional[npt.ArrayLike] = None, mask: Union[npt.ArrayLike, Path, None] = None,
             mode: str = "default", max_kernels: Optional[int] = None, threads: Optional[int] = None,
             progress: Progress = None, *, parameterisation: str = "monitor",
             monitor: Union[str, Sequence[str], None] = None, predict_errors: bool = True,
             keep_outliers: bool = False, memory: float = 4.0) -> Field:
    """Estimate a reflectance field from photographs under known lights.

    Parameters
    ----------
    light : array [N, h, w, 3], sequence of paths, pattern, or Session
        Light maps: what the monitor or the environment emitted, scene-linear, not negative.
    observed : array [N, H, W, 3], sequence of paths or pattern
        Photograph j was taken under light map j; scene-linear, ambient light subtracted. Omit it with a Session.
    sigma : array [N, H, W, 3], optional
        Standard deviation of each sample, infinite where nothing was measured. Files have it in their channels.
    mask : array [H, W] or path, optional
        Pixels of value 0 (in files: below one half) are not estimated.
    mode : {"default", "refined", "paper", "fast"}
        "default" is "refined", the most accurate; "paper" is the method published in 2004.
    max_kernels : int, optional
        Cap on the kernels per pixel, 1 to 255; None: as many as the data support.
    threads : int, optional
        Limit of threads; None: all cores. The result does not depend on it.
    progress : callable or tqdm bar, optional
        ``progress(stage, done, total)``, called in the thread of the caller.
    parameterisation : {"monitor", "lat_long", "cube"}
        Of the light maps, unless a Session states it.
    monitor : str or sequence of str, optional
        Placement of the monitor, such as "520x320@600,yaw=90" (mm, degrees), for relighting by environments.
    predict_errors : bool
        Predict the error of each pixel; takes a fifth more time.
    keep_outliers : bool
        Keep photographs that do not fit the others.
    memory : float
        Limit in GiB for bands of rows and the field, besides the arrays that are given.

    Returns
    -------
    Field

    Raises
    ------
    InputError
        Arrays or files do not fit together, or an option is out of range.
    KeyboardInterrupt
        Ctrl-C.

    Notes
    -----
    float32 arrays of any strides are used as they are, without a copy; bands of rows are copied as they are needed. Other
    types are converted as a whole: float16 and float64 by value, uint16 and uint8 such that 65535 and 255 become 1.

    Source: Matusik, Loper and Pfister, "Progressively-Refined Reflectance Functions from Natural Illumination", 2004.
    """
    options = _refield.EstimateOptions(mode, max_kernels or 0, predict_errors, keep_outliers, memory)
    if isinstance(light, Session) or _is_path(light) or _are_paths(light):
        if isinstance(light, Session):
            if observed is not None:
                raise InputError("observed: a Session has its own photographs; omit them")
            session = light
        else:
            if not (_is_path(observed) or _are_paths(observed)):
                raise InputError("observed: light is given as files; give files here, too")
            session = Session.pairs(light, observed, parameterisation)  # type: ignore[arg-type]
        if sigma is not None:
            raise InputError("sigma: photographs in files have it in their channels sigma.R, sigma.G and sigma.B; omit it")
        if mask is not None and not _is_path(mask):
            raise InputError("mask: give the path of an image for photographs in files")
        return Field(_refield.estimate_session(session._native, mask, _texts(monitor), options, _progress(progress), threads))
    if observed is None:
        raise InputError("observed is missing; give the photographs taken under the light maps")
    pixels = None
    if mask is not None:
        pixels = read_image(mask).max(axis=2) > 0.5 if isinstance(mask, (str, os.PathLike)) else np.asarray(mask) != 0
    return Field(_refield.estimate_arrays(
        _floats(light, "light"), _floats(observed, "observed"),  # type: ignore[arg-type]
        None if sigma is None else _floats(sigma, "sigma"), pixels, parameterisation, _texts(monitor), options,
        _progress(progress), threads))


def _are_paths(value: object) -> bool:
    return isinstance(value, (list, tuple)) and len(value) > 0 and all(_is_path(entry) for entry in value)


class ImageError(NamedTuple):
    """Errors of one image of a series."""

    name: str
    relative_rmse: float
    tone_mapped_psnr_db: float


class Comparison(NamedTuple):
    """Errors over a series of images, as `refield compare` prints them (docs/reference/conventions.md#errors)."""

    kind: str  #: of light; empty where not known
    images: int
    relative_rmse: float  #: over all samples
    median: float  #: of the pixels' relative RMSE
    percentile_90: float
    tone_mapped_psnr_db: float
    per_image: list[ImageError]


def _comparison(figures: dict[str, Any]) -> Comparison:
    return Comparison(**figures)._replace(per_image=[ImageError(*image) for image in figures["per_image"]])


def compare(predicted: Union[Field, npt.ArrayLike], observed: Union[Session, npt.ArrayLike],
            sigma: Optional[npt.ArrayLike] = None, mask: Optional[npt.ArrayLike] = None, *, truth: Optional[Field] = None,
            progress: Progress = None) -> list[Comparison]:
    """Measure the error of predicted images against photographs.

    Parameters
    ----------
    predicted : Field, or array [H, W, 3] or [N, H, W, 3]
    observed : Session, or array
        With a Field: the session whose held-out photographs are compared with; per kind of light.
    sigma : array, optional
        Samples of infinite sigma are left out.
    mask : array [H, W], optional
        Pixels that count.
    truth : Field, optional
        Its noise-free images replace the photographs of the session.

    Returns
    -------
    list of Comparison
        One per kind of light; of arrays one.

    Raises
    ------
    InputError
        Shapes differ, or the session has no held-out frame.
    """
    if isinstance(predicted, Field):
        if not isinstance(observed, Session):
            raise InputError("observed: a field is compared with a Session; relight the field and compare the images instead")
        figures = _refield.compare_field(predicted._native, observed._native, truth._native if truth else None,
                                         _progress(progress))
        return [_comparison(entry) for entry in figures]
    if truth is not None:
        raise InputError("truth requires a Field and a Session")

    def series(array: Any, name: str) -> Array:
        images = _floats(array, name)
        return images[np.newaxis] if images.ndim == 3 else images

    return [_comparison(_refield.compare_arrays(series(predicted, "predicted"), series(observed, "observed"),
                                                None if sigma is None else series(sigma, "sigma"),
                                                None if mask is None else np.asarray(mask) != 0))]


def simulate(recipe: Path, folder: Path, *, width: Optional[int] = None, height: Optional[int] = None,
             light_width: Optional[int] = None, light_height: Optional[int] = None, train: Optional[int] = None,
             natural: Optional[int] = None, bars: Optional[int] = None, squares: Optional[int] = None,
             seed: Optional[int] = None, quality: int = 2, noise: float = 0.0, transport: bool = True,
             threads: Optional[int] = None, progress: Progress = None) -> Session:
    """Make a synthetic capture session with exact light transport by ray tracing, as `refield simulate`.

    Parameters
    ----------
    recipe : path
        Description of the data set (docs/reference/synthetic-scenes.md).
    folder : path
        Folder to create. ``transport.rfield`` in it is the exact field.
    width, height, light_width, light_height, train, natural, bars, squares, seed : int, optional
        Replace what the recipe says: pixels, texels, numbers of light maps per kind.
    quality : int
        Of ray tracing, 1 to 3.
    noise : float
        Relative standard deviation of Gaussian noise on the photographs.
    transport : bool
        Write ``transport.rfield``.

    Returns
    -------
    Session
    """
    given = {"width": width, "height": height, "light_width": light_width, "light_height": light_height, "train": train,
             "natural": natural, "bars": bars, "squares": squares, "seed": seed}
    sizes = {name: value for name, value in given.items() if value is not None}
    return Session._of(_refield.simulate(recipe, folder, sizes, quality, noise, transport, _progress(progress), threads))


def precompute(scene: Path, method: str = "clusters", *, resolution: Optional[int] = None, epsilon: Optional[float] = None,
               samples: Optional[int] = None, image: bool = False, order: Optional[int] = None,
               directions: Optional[int] = None, radius: Optional[float] = None, bits: int = 8,
               threads: Optional[int] = None, progress: Progress = None) -> Field:
    """Precompute the light transport of meshes as a field over a cube map, as `refield simulate prt`.

    Parameters
    ----------
    scene : path
        Scene (docs/reference/scene-files.md) or mesh (OBJ, PLY, OFF, glTF).
    method : {"clusters", "sh"}
        Clustered environment lights (all frequencies; Johan and Nishita) or spherical harmonics (low frequencies, the
        smallest field; Fujita and Kanai 2004).
    resolution, epsilon, samples, image
        Of clusters: texels per side of a cube face (1024), clustering error threshold (1e-4), light samples per side of
        a cluster (3), the scene camera's image instead of a mesh.
    order, directions, radius
        Of harmonics: order n for n² coefficients (5), rays per vertex (2048), distance of the lights in scene units
        (0: infinite).
    bits : {8, 16}
        Per weight.

    Returns
    -------
    Field
        `Field.relight` takes cube maps of `Field.light_shape`; `environment` makes them.

    Raises
    ------
    InputError, FormatError
        A scene that does not suit, or an option out of range.
    """
    given = {"resolution": resolution, "epsilon": epsilon, "samples": samples, "image": 1.0 if image else None, "order": order,
             "directions": directions, "radius": radius}
    settings = {name: float(value) for name, value in given.items() if value is not None}
    return Field(_refield.precompute(scene, method, settings, bits, _progress(progress), threads))


def hdr_merge(images: Union[npt.ArrayLike, Sequence[Path]], exposures: Optional[Sequence[float]] = None, *,
              response: str = "", full_scale_electrons: float = 20000.0,
              read_noise_electrons: float = 5.0) -> tuple[Array, Array]:
    """Merge exposures of one view into linear radiance, as `refield hdr`.

    Parameters
    ----------
    images : array [E, H, W, 3] or sequence of paths
        Arrays are linear, clipped at 1. Files may be PNG, TIFF, JPEG, EXR or camera RAW.
    exposures : sequence of float, optional
        Exposure times in seconds; files may state them in their metadata.
    response : str
        Of files: "linear", "srgb", "gamma:X" or a calibration.toml; empty: srgb for 8 bits, else linear.
    full_scale_electrons, read_noise_electrons : float
        Of the camera, for weights and sigma.

    Returns
    -------
    radiance, sigma : array [H, W, 3]
        Radiance 1 fills the range in one second; sigma is infinite where all exposures are clipped.
    """
    seconds = [] if exposures is None else [float(exposure) for exposure in exposures]
    if _are_paths(images):
        return _refield.merge_files(list(images), seconds, response,  # type: ignore[arg-type]
                                    full_scale_electrons, read_noise_electrons)
    return _refield.merge_arrays(_floats(images, "images"), seconds, full_scale_electrons,  # type: ignore[arg-type]
                                 read_noise_electrons)


def environment(map: Union[npt.ArrayLike, Path], field: Optional[Field] = None, *,
                shape: Optional[tuple[int, ...]] = None, monitor: Union[str, Sequence[str], None] = None,
                parameterisation: str = "monitor", yaw: float = 0.0, pitch: float = 0.0, roll: float = 0.0) -> Array:
    """The light map that an environment gives: what of it shines through the monitor's window, or all of it.

    Parameters
    ----------
    map : array [h, 2h, 3] (lat-long) or [6s, s, 3] (cube), or path
    field : Field, optional
        Whose light map it is for; brings shape, parameterisation and placements along.
    shape : (h, w) or (h, w, 3), optional
        Without `field`: size of the light map.
    monitor : str or sequence of str, optional
        Placement, such as "520x320@600,yaw=90" (mm, degrees), where the field does not know it.
    yaw, pitch, roll : float
        Rotation of the environment in degrees: to the right, down in front of the camera, right side up.

    Returns
    -------
    array [h, w, 3], float32
        Each texel is the mean radiance over its solid angle.
    """
    array = read_image(map) if isinstance(map, (str, os.PathLike)) else _floats(map, "map")
    turn = (yaw, pitch, roll)
    if field is not None:
        return _refield.environment_of_field(array, field._native, _texts(monitor), turn)
    if shape is None or len(shape) not in (2, 3):
        raise InputError("give a field, or the shape (height, width) of the light map")
    return _refield.environment(array, shape[0], shape[1], parameterisation, _texts(monitor), turn)


from . import dynamic  # noqa: E402
from .evaluation import Evaluation, evaluate  # noqa: E402
