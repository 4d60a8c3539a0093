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
import pathlib
import tempfile
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple, Optional, Union

import numpy as np
import numpy.typing as npt

from . import _arguments, _refield
from ._arguments import Array, Path, Progress
from ._refield import DeviceError, Error, FormatError, InputError, SolverError

__all__ = [
    "estimate", "Field", "Relighter", "Kernel", "Session", "Frame", "compare", "Comparison", "ImageError", "evaluate",
    "Evaluation", "simulate", "precompute", "hdr_merge", "environment", "read_image", "write_exr", "show", "dynamic",
    "Error", "InputError", "FormatError", "DeviceError", "SolverError",
]
__version__: str = _refield.version


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
    return _refield.read_image(_arguments.path(path))


def write_exr(path: Path, image: npt.ArrayLike) -> None:
    """Write an image as OpenEXR with 32-bit floats.

    Parameters
    ----------
    path : path
        Ends in ".exr". The file appears when it is complete.
    image : array [H, W, 3]
        Scene-linear RGB; float32, float16 or float64 by value, uint16 and uint8 such that 65535 and 255 become 1.

    Raises
    ------
    InputError, DeviceError
        The path has another ending, the array another shape or type; the file cannot be written.
    """
    _refield.write_exr(_arguments.path(path), _arguments.floats(image, "image"))


def show(pictures: Any, titles: Union[str, Sequence[str]] = (), exposure: Optional[float] = None, columns: int = 4) -> Any:
    """Draw pictures beside one another as a screen shows them; needs Matplotlib.

    Parameters
    ----------
    pictures : array [H, W, 3] or [H, W], or a list of them
        Scene-linear RGB, sRGB-encoded for display. An array [H, W], such as `Field.predicted_error`, is drawn in false
        colour with a scale, whose upper end is its 99th percentile.
    titles : str or sequence of str, optional
        Text above each picture.
    exposure : float, optional
        Factor applied to the radiance; what exceeds 1 is clipped. None: each picture has its own, which maps the 99th
        percentile of its brightest channel to white, as in PNG files of `refield relight`. Give one to compare pictures.
    columns : int
        Maximum number of pictures in a row.

    Returns
    -------
    matplotlib.figure.Figure
        A notebook displays it as the result of a cell; ``savefig`` writes it.

    Raises
    ------
    InputError
        A picture has another shape; there are more titles than pictures.
    """
    from matplotlib import pyplot

    factor = None if exposure is None else _arguments.number(exposure, "exposure")
    single = not isinstance(pictures, (list, tuple)) and np.ndim(pictures) < 4
    shown = [_arguments.floats(picture, "pictures") for picture in ([pictures] if single else pictures)]
    texts = _arguments.texts(titles, "titles")
    for picture in shown:
        if not (picture.ndim == 2 or picture.ndim == 3 and picture.shape[2] == 3) or picture.size == 0:
            raise InputError(f"pictures: has the shape {'×'.join(map(str, picture.shape))}; give height×width×3 or height×width")
    if not shown or len(texts) > len(shown):
        raise InputError(f"titles: {len(texts)} for {len(shown)} pictures; give one for each")
    if _arguments.whole(columns, "columns") < 1:
        _arguments.refuse("columns", columns, "1 or more")
    columns = min(columns, len(shown))
    rows = -(-len(shown) // columns)
    width = min(5.0, 12.0 / columns)
    height = width * max(picture.shape[0] / picture.shape[1] for picture in shown) + (0.3 if texts else 0.05)
    figure = pyplot.figure(figsize=(width * columns, height * rows), layout="constrained")
    for place, picture in enumerate(shown):
        axes = figure.add_subplot(rows, columns, place + 1)
        axes.set_axis_off()
        axes.set_title(texts[place] if place < len(texts) else "", fontsize=10)
        brightest = picture if picture.ndim == 2 else picture.max(axis=2)
        lit = brightest[np.isfinite(brightest) & (brightest > 0)]
        white = float(np.quantile(lit, 0.99, method="higher")) if lit.size else 1.0
        if picture.ndim == 2:
            figure.colorbar(axes.imshow(picture, vmin=0.0, vmax=white), ax=axes, fraction=0.04)
            continue
        linear = np.clip(np.nan_to_num(picture) * (1.0 / white if factor is None else factor), 0.0, 1.0)
        axes.imshow(np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1.0 / 2.4) - 0.055))
    pyplot.close(figure)  # shown where it is returned to, once
    return figure


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
        if not isinstance(field, Field):
            _arguments.refuse("field", field, "a Field")
        self._frames = _refield.Frames(field._native, _arguments.text(precision, "precision"))

    def relight(self, light: npt.ArrayLike, out: Optional[Array] = None) -> Array:
        """The scene under one light map.

        Parameters
        ----------
        light : array [h, w, 3]
            Of the field's `light_shape`; scene-linear radiance.
        out : array [H, W, 3], optional
            Receives the image without a copy: float32 in C order.

        Returns
        -------
        array [H, W, 3], float32
            Scene-linear radiance in the units of the light; `out` where it is given.

        Raises
        ------
        InputError
            The light or `out` has another shape, or the light is not finite.

        Notes
        -----
        The sum over the kernels of a pixel, weight times the sum of the light under the kernel (Matusik et al. 2004,
        equations 3 and 4), with weights rounded as `Field.relighter` says.
        """
        return self._frames.relight(_arguments.light_for(out, light), out)

    def update(self, light: npt.ArrayLike, changed: tuple[int, int, int, int], out: Optional[Array] = None) -> Array:
        """The same after `light` changed inside a rectangle alone, in less time the less of it changed.

        Parameters
        ----------
        light : array [h, w, 3]
            The whole light map.
        changed : (x0, y0, x1, y1)
            Columns x0 to x1 - 1 and rows y0 to y1 - 1, outside which the light is that of the call before. The first
            call after `relight` computes the whole image.
        out : array [H, W, 3], optional
            Receives the image: float32 in C order.

        Returns
        -------
        array [H, W, 3], float32

        Raises
        ------
        InputError
            As of `relight`; `changed` is empty or reaches outside the light map.
        """
        if np.shape(changed) != (4,):
            _arguments.refuse("changed", changed, "four numbers (x0, y0, x1, y1)")
        x0, y0, x1, y1 = (_arguments.whole(side, "changed") for side in changed)
        if x0 >= x1 or y0 >= y1:
            _arguments.refuse("changed", (x0, y0, x1, y1), "x0 below x1 and y0 below y1")
        return self._frames.update(_arguments.light_for(out, light), (x0, y0, x1, y1), out)


class Field:
    """A reflectance field: the transport T of a scene, as estimated, simulated, precomputed or loaded.

    Methods may be called from several threads at a time. Fields can be pickled.
    """

    def __init__(self, native: _refield.Field) -> None:
        if not isinstance(native, _refield.Field):
            raise InputError("a Field is made by refield.estimate, refield.precompute and Field.load")
        self._native = native

    @staticmethod
    def load(path: Path) -> Field:
        """Read a field (.rfield), packed or not.

        Raises
        ------
        DeviceError, FormatError
            The file is missing, of another kind or version, or damaged.
        """
        return Field(_refield.Field.load(_arguments.path(path)))

    def save(self, path: Path) -> None:
        """Write the field as one file, which appears when it is complete.

        Parameters
        ----------
        path : path
            Ends in ".rfield". Missing folders are created.

        Raises
        ------
        InputError, DeviceError
            The path has another ending; the file cannot be written.
        """
        self._native.save(_arguments.path(path))

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
    def colour_space(self) -> str:
        """Of its images: "linear Rec.709", or "camera RGB" of sessions without a colour chart."""
        return self._native.colour_space

    @property
    def rig(self) -> dict[str, Any]:
        """What the photographs were corrected for, empty where nothing was found: "photographs" (names), "light_of" (number
        of the light of each), "shift_px" (right, down), "turn" (clockwise in radians, growth; about the middle), "mixing"
        (camera channel per primary), "tone" (exponents), "white", "gain" (of each photograph and channel) and "room" (share of the mean photograph)."""
        return dict(self.provenance.get("rig", {}))

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

        It holds for photographs as noisy as those of the estimate, under light of their kind. NaN where nothing is known:
        outside the mask, without light, where a channel was not measured, everywhere with few lights.
        """
        return self._native.predicted_error

    def predicted_error_under(self, light: Union[npt.ArrayLike, Path]) -> Optional[Array]:
        """Relative RMSE to be expected under one light.

        As `predicted_error`, but for this light: bars or single sources show more of what the field does not know than
        the light that it was estimated from.

        Parameters
        ----------
        light : array [h, w, 3] or path
            Of `light_shape`; scene-linear radiance.

        Returns
        -------
        array [H, W], float32, or None
            0 where the picture is black, NaN where `predicted_error` is. None where the field has no predicted error.

        Raises
        ------
        InputError
            The light has another shape.
        """
        return self._native.predicted_error_under(_arguments.floats(self._light(light), "light"))

    def _light(self, light: Union[npt.ArrayLike, Path]) -> npt.ArrayLike:
        """An array, or the map of a path, repaired as the command line does."""
        if not _arguments.is_path(light):
            return light  # type: ignore[return-value]
        return _refield.read_light_map(_arguments.path(light), self.parameterisation)

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
        """The scene under new light, B = T L, as `refield relight` gives it.

        Parameters
        ----------
        light : array [h, w, 3] or [N, h, w, 3], or path
            One light map or a batch, of `light_shape`; scene-linear radiance, in the units of the light maps that the
            field was estimated with. Of a path: an image file with one map.
        out : array, optional
            Receives the result: float32 in C order. Images are written into it without a copy.
        progress : callable or tqdm bar, optional
            ``progress(stage, done, total)``.
        threads : int, optional
            Limit of threads; None: all cores.

        Returns
        -------
        array [H, W, 3] or [N, H, W, 3], float32
            Scene-linear radiance. Up to 11 maps by the plain product. For more, the field is laid out for speed, which rounds weights to 16
            bits (relative RMSE below 1e-5). For single maps at a high rate use `relighter`. Fields of meshes are seen
            by their standard camera.

        Raises
        ------
        InputError
            The light or `out` has another shape, or the light is not finite or too bright for 32-bit floats.
        DeviceError, FormatError
            The file of a path is missing, or is no image.

        Notes
        -----
        Where more than 1 % of the light comes from texels that were black in all training light maps, the logger
        "refield" says so. Source: Matusik et al. 2004, equations 1 to 4.
        """
        array = _arguments.light_for(out, self._light(light))
        return self._native.relight(array, out, _arguments.progress_function(progress), _arguments.thread_limit(threads))

    def relighter(self, precision: str = "fast") -> Relighter:
        """For many frames, also with partial updates of the light.

        Parameters
        ----------
        precision : {"fast", "fine"}
            Weights of 8 bits (relative RMSE about 4e-4) or 16 bits (below 1e-5).

        Returns
        -------
        Relighter

        Raises
        ------
        InputError
            The field is of a mesh, or `precision` is another word.
        """
        return Relighter(self, precision)

    def transport(self, x: int, y: int) -> Array:
        """The reflectance function of a pixel: a row of T over the light map.

        Parameters
        ----------
        x, y : int
            Column and row of the pixel, from 0; row 0 is the top.

        Returns
        -------
        array [h, w, 3], float32
            Radiance of the pixel per radiance of each texel, per channel: the pixel's value is the sum of its products
            with the light map. Zero for pixels outside the mask.

        Raises
        ------
        InputError
            The pixel is outside the image, or the field is of a mesh.

        Notes
        -----
        Sum of the pixel's kernels (Matusik et al. 2004, equation 3).
        """
        return self._native.transport(_arguments.whole(x, "x"), _arguments.whole(y, "y"))

    def lit_by(self, u: int, v: int) -> Array:
        """The image under light from one texel: a column of T.

        Parameters
        ----------
        u, v : int
            Column and row of the texel, from 0; row 0 is the top.

        Returns
        -------
        array [H, W, 3], float32
            Radiance under a light map that is 1 in that texel and 0 elsewhere.

        Raises
        ------
        InputError
            The texel is outside the light map.

        Notes
        -----
        The response to a single light source, as light stages measure it (Debevec et al. 2000). Photographs under larger
        patterns determine it only as finely as the kernels divide the light map.
        """
        return self._native.lit_by(_arguments.whole(u, "u"), _arguments.whole(v, "v"))

    def kernels(self, x: int, y: int) -> list[Kernel]:
        """The kernels that a pixel's reflectance function consists of.

        Parameters
        ----------
        x, y : int
            Column and row of the pixel, from 0; row 0 is the top.

        Returns
        -------
        list of Kernel
            Most energy first; empty for pixels outside the mask.

        Raises
        ------
        InputError
            The pixel is outside the image, or the field is of a mesh.

        Notes
        -----
        Boxes are those of Matusik et al. 2004, equations 3 and 4; hats are bilinear.
        """
        return [Kernel(*entry) for entry in self._native.kernels(_arguments.whole(x, "x"), _arguments.whole(y, "y"))]

    def pack(self, max_error: float = 1e-3) -> Field:
        """A copy with weights of 8 or 16 bits and without negligible kernels.

        Parameters
        ----------
        max_error : float
            Maximum relative RMSE of its images against those of the full field, 2e-5 or more.

        Returns
        -------
        Field
            What the packing cost is in ``provenance["pack"]``.

        Raises
        ------
        InputError
            The field is already packed, or weights of 16 bits cannot keep to `max_error`.
        """
        return Field(self._native.pack(_arguments.number(max_error, "max_error")))

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
        self._native = _refield.Session.read(_arguments.path(folder, "folder"))

    @classmethod
    def _of(cls, native: _refield.Session) -> Session:
        session = cls.__new__(cls)
        session._native = native
        return session

    @classmethod
    def pairs(cls, light: Union[Path, Sequence[Path]], observed: Union[Path, Sequence[Path]],
              parameterisation: str = "monitor") -> Session:
        """A session of image files of other tools, all for training.

        Parameters
        ----------
        light, observed : pattern or sequence of paths
            Two patterns, such as "light/*.exr", are paired by the text that the wildcards match; sequences by place.
        parameterisation : {"monitor", "lat_long", "cube"}
            Of the light maps.

        Returns
        -------
        Session

        Raises
        ------
        InputError
            Nothing matches, the numbers of files differ, or images differ in size.
        DeviceError, FormatError
            A file is missing, or is no image.
        """
        how = _arguments.text(parameterisation, "parameterisation")
        if _arguments.is_path(light) and _arguments.is_path(observed):
            patterns = _arguments.path(light, "light"), _arguments.path(observed, "observed")
            return cls._of(_refield.Session.globs(*patterns, how))
        if _arguments.is_path(light) or _arguments.is_path(observed):
            raise InputError("light and observed: give two patterns or two sequences of paths")
        return cls._of(_refield.Session.pairs(_arguments.paths(light, "light"), _arguments.paths(observed, "observed"), how))

    def held_out(self, every: int) -> Session:
        """A copy in which some training frames are held out for comparison, as by --hold-out.

        Parameters
        ----------
        every : int
            Every N-th training frame is held out, 2 or more.

        Returns
        -------
        Session
            Its `test` has these frames and those that were held out before. Files are not copied.

        Raises
        ------
        InputError
            `every` is below 2, or so large that no frame would be held out.
        """
        return self._of(self._native.hold_out(_arguments.whole(every, "every")))

    def __len__(self) -> int:
        return len(self._native)

    def __getitem__(self, index: int) -> Frame:
        place = _arguments.whole(index, "index")
        if not -len(self) <= place < len(self):
            raise IndexError(f"frame {place} of {len(self)}")
        return Frame(self, place % len(self))

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
    def colour_space(self) -> str:
        """Of its photographs: "linear Rec.709" with the matrix of a colour chart, otherwise "camera RGB"."""
        return self._native.colour_space

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
             mode: str = "refined", max_kernels: Optional[int] = None, threads: Optional[int] = None,
             progress: Progress = None, *, parameterisation: str = "monitor",
             placement: Union[str, Sequence[str], None] = None, predict_errors: bool = True,
             keep_outliers: bool = False, rig: Union[str, Path, dict[str, Any]] = "auto", memory: float = 4.0) -> Field:
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
    mode : {"refined", "paper", "fast"}
        "refined" is the most accurate; "paper" is the method published in 2004.
    max_kernels : int, optional
        Cap on the kernels per pixel, 1 to 255; None: as many as the data support.
    threads : int, optional
        Limit of threads; None: all cores. The result does not depend on it.
    progress : callable or tqdm bar, optional
        ``progress(stage, done, total)``, called in the thread of the caller.
    parameterisation : {"monitor", "lat_long", "cube"}
        Of the light maps, unless a Session states it.
    placement : str or sequence of str, optional
        Placement of the monitor, such as "520x320@600,yaw=90" (mm, degrees), for relighting by environments.
    predict_errors : bool
        Predict the error of each pixel; takes a fifth more time.
    keep_outliers : bool
        Keep photographs that do not fit the others.
    rig : "auto", "off", path or dict
        "auto": find wrong pairs, motion of the camera, colour mixing, tone curve and brightness from the photographs, and
        correct them. "off": use the pairs as they are. Otherwise a model: Field.rig of another estimate, or a JSON file of it.
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
    if max_kernels is not None and _arguments.whole(max_kernels, "max_kernels") < 1:
        _arguments.refuse("max_kernels", max_kernels, "1 or more, or None for as many as the data support")
    options = _refield.EstimateOptions(
        _arguments.text(mode, "mode"), 0 if max_kernels is None else _arguments.whole(max_kernels, "max_kernels"),
        _arguments.flag(predict_errors, "predict_errors"), _arguments.flag(keep_outliers, "keep_outliers"),
        _arguments.rig(rig), _arguments.number(memory, "memory"))
    how, places = _arguments.text(parameterisation, "parameterisation"), _arguments.texts(placement, "placement")
    report, limit = _arguments.progress_function(progress), _arguments.thread_limit(threads)
    if isinstance(light, Session) or _arguments.is_path(light) or _arguments.are_paths(light):
        if isinstance(light, Session):
            if observed is not None:
                raise InputError("observed: a Session has its own photographs; omit them")
            session = light
        else:
            if not (_arguments.is_path(observed) or _arguments.are_paths(observed)):
                raise InputError("observed: light is given as files; give files here, too")
            session = Session.pairs(light, observed, parameterisation)  # type: ignore[arg-type]
        if sigma is not None:
            raise InputError("sigma: photographs in files have it in their channels sigma.R, sigma.G and sigma.B; omit it")
        if mask is not None and not _arguments.is_path(mask):
            raise InputError("mask: give the path of an image for photographs in files")
        file = None if mask is None else _arguments.path(mask, "mask")
        return Field(_refield.estimate_session(session._native, file, places, options, report, limit))
    if observed is None:
        raise InputError("observed is missing; give the photographs taken under the light maps")
    lights, photographs = _arguments.floats(light, "light"), _arguments.floats(observed, "observed")  # type: ignore[arg-type]
    if photographs.ndim != 4 or len(photographs) == 0:
        raise InputError(f"observed: has the shape {'×'.join(map(str, photographs.shape))}; give images×height×width×3")
    noise = None if sigma is None else _arguments.floats(sigma, "sigma")
    counted = None
    if mask is not None:
        counted = _arguments.pixels(read_image(mask).max(axis=2) > 0.5 if _arguments.is_path(mask) else mask,  # type: ignore[arg-type]
                                    photographs.shape)
    return Field(_refield.estimate_arrays(lights, photographs, noise, counted, how, places, options, report, limit))


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
    #: Of these images, those that the field was estimated from, by names and light maps, so that their errors are
    #: training errors; None: not known.
    trained_on: Optional[int] = None


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
        Shapes differ, a measured sample is not finite, or the session has no held-out frame.
    """
    if isinstance(predicted, Field):
        if not isinstance(observed, Session):
            raise InputError("observed: a field is compared with a Session; relight the field and compare the images instead")
        if truth is not None and not isinstance(truth, Field):
            _arguments.refuse("truth", truth, "a Field")
        figures = _refield.compare_field(predicted._native, observed._native, truth._native if truth is not None else None,
                                         _arguments.progress_function(progress))
        return [_comparison(entry) for entry in figures]
    if truth is not None:
        raise InputError("truth requires a Field and a Session")

    def series(array: Any, name: str) -> Array:
        images = _arguments.floats(array, name)
        return images[np.newaxis] if images.ndim == 3 else images

    photographs = series(observed, "observed")
    return [_comparison(_refield.compare_arrays(series(predicted, "predicted"), photographs,
                                                None if sigma is None else series(sigma, "sigma"),
                                                None if mask is None else _arguments.pixels(mask, photographs.shape)))]


def simulate(recipe: Path, folder: Path, *, size: Optional[tuple[int, int]] = None,
             light_size: Optional[tuple[int, int]] = None, train: Optional[int] = None,
             test: Optional[tuple[int, int, int]] = None, seed: Optional[int] = None, quality: int = 2, noise: float = 0.0,
             transport: bool = True, threads: Optional[int] = None, progress: Progress = None) -> Session:
    """Make a synthetic capture session with exact light transport by ray tracing, as `refield simulate`.

    Parameters
    ----------
    recipe : path
        Description of the data set (docs/reference/synthetic-scenes.md).
    folder : path
        Folder to create. ``transport.rfield`` in it is the exact field.
    size, light_size : (width, height), optional
        Replace what the recipe says: pixels of the photographs, texels of the light maps.
    train, seed : int, optional
        Number of light maps for estimation and seed of all random numbers, instead of the recipe's.
    test : (natural, bars, squares), optional
        Numbers of held-out light maps, instead of the recipe's.
    quality : int
        Of ray tracing, 1 to 3.
    noise : float
        Relative standard deviation of Gaussian noise on the photographs.
    transport : bool
        Write ``transport.rfield``.

    Returns
    -------
    Session

    Raises
    ------
    InputError, FormatError
        The recipe cannot be used, a number is out of range, or the folder is not empty.
    """
    sizes = {}
    for option, value, names in (("size", size, ("width", "height")), ("light_size", light_size, ("light_width", "light_height")),
                                 ("test", test, ("natural", "bars", "squares")), ("train", train, ("train",)),
                                 ("seed", seed, ("seed",))):
        if value is None:
            continue
        values = value if len(names) > 1 else (value,)
        if not isinstance(values, (list, tuple)) or len(values) != len(names):
            _arguments.refuse(option, value, f"the {len(names)} numbers {', '.join(names)}")
        sizes.update({name: _arguments.whole(number, option) for name, number in zip(names, values)})
    return Session._of(_refield.simulate(
        _arguments.path(recipe, "recipe"), _arguments.path(folder, "folder"), sizes, _arguments.whole(quality, "quality"),
        _arguments.number(noise, "noise"), _arguments.flag(transport, "transport"), _arguments.progress_function(progress),
        _arguments.thread_limit(threads)))


def precompute(scene: Path, method: str = "clusters", *, resolution: Optional[int] = None, epsilon: Optional[float] = None,
               diffuse_bounces: Optional[int] = None, image: bool = False, pixel_samples: Optional[int] = None,
               sh_order: Optional[int] = None, directions: Optional[int] = None, radius: Optional[float] = None,
               threads: Optional[int] = None, progress: Progress = None) -> Field:
    """Precompute the light transport of meshes as a field over a cube map, as `refield precompute`.

    Parameters
    ----------
    scene : path
        Scene (docs/reference/scene-files.md) or mesh (OBJ, PLY, OFF, glTF).
    method : {"clusters", "sh"}
        Clustered environment lights (all frequencies; Johan and Nishita) or spherical harmonics (low frequencies, the
        smallest field; Fujita and Kanai 2004).
    resolution, epsilon, diffuse_bounces, image, pixel_samples
        Of clusters: texels per side of a cube face (1024), clustering error threshold (1e-4), diffuse reflections of
        indirect light (0), the scene camera's image instead of a mesh, and of an image the samples per side of a
        pixel (1).
    sh_order, directions, radius
        Of harmonics: order n for n² coefficients (5), rays per vertex (2048), distance of the lights in scene units
        (0: infinite).

    Returns
    -------
    Field
        `Field.relight` takes cube maps of `Field.light_shape`; `environment` makes them.

    Raises
    ------
    InputError, FormatError
        A scene that does not suit, an option out of range or of the other method.
    """
    of_method = {"clusters": {"resolution": resolution, "epsilon": epsilon, "diffuse_bounces": diffuse_bounces,
                              "image": True if _arguments.flag(image, "image") else None,
                              "pixel_samples": pixel_samples},
                 "sh": {"sh_order": sh_order, "directions": directions, "radius": radius}}
    settings = {}
    for owner, options in of_method.items():
        for name, value in options.items():
            if value is not None:
                if method in of_method and method != owner:
                    raise InputError(f"{name} is an option of the method '{owner}'; omit it for '{method}'")
                if name == "pixel_samples" and not image:
                    raise InputError("pixel_samples is an option of images; omit it, or give image=True")
                settings[name] = (_arguments.number if name in ("epsilon", "radius") else _arguments.whole)(value, name)
    return Field(_refield.precompute(_arguments.path(scene, "scene"), _arguments.text(method, "method"), settings,
                                     _arguments.progress_function(progress),
                                     _arguments.thread_limit(threads)))


def hdr_merge(images: Union[npt.ArrayLike, Sequence[Path]], exposures: Optional[Sequence[float]] = None, *,
              response: str = "", full_scale_electrons: float = 20000.0,
              read_noise_electrons: float = 5.0) -> tuple[Array, Array]:
    """Merge exposures of one view into linear radiance, as `refield acquire import`.

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

    Raises
    ------
    InputError
        Images and exposure times do not belong together, or a number is out of range.
    DeviceError, FormatError
        A file is missing, or is no image.
    """
    if exposures is not None and not hasattr(exposures, "__iter__"):
        _arguments.refuse("exposures", exposures, "one exposure time in seconds per image")
    seconds = [] if exposures is None else [_arguments.number(exposure, "exposures") for exposure in exposures]
    full_scale = _arguments.number(full_scale_electrons, "full_scale_electrons")
    read_noise = _arguments.number(read_noise_electrons, "read_noise_electrons")
    if full_scale <= 0.0:
        _arguments.refuse("full_scale_electrons", full_scale, "a number above 0")
    if read_noise < 0.0:
        _arguments.refuse("read_noise_electrons", read_noise, "0 or more")
    if _arguments.are_paths(images):
        return _refield.merge_files(_arguments.paths(images, "images"), seconds, _arguments.text(response, "response"),
                                    full_scale, read_noise)
    if response:
        raise InputError("response is for files; arrays are linear: omit it")
    return _refield.merge_arrays(_arguments.floats(images, "images"), seconds, full_scale, read_noise)  # type: ignore[arg-type]


def environment(map: Union[npt.ArrayLike, Path], field: Optional[Field] = None, *,
                shape: Optional[tuple[int, ...]] = None, placement: Union[str, Sequence[str], None] = None,
                parameterisation: str = "monitor", yaw: float = 0.0, pitch: float = 0.0, roll: float = 0.0) -> Array:
    """The light map that an environment gives: what of it shines through the monitor's window, or all of it.

    Parameters
    ----------
    map : array [h, 2h, 3] (lat-long) or [6s, s, 3] (cube), or path
    field : Field, optional
        Whose light map it is for; brings shape, parameterisation and placements along.
    shape : (h, w) or (h, w, 3), optional
        Without `field`: size of the light map.
    placement : str or sequence of str, optional
        Of the monitor, such as "520x320@600,yaw=90" (mm, degrees), where the field does not know it.
    yaw, pitch, roll : float
        Rotation of the environment in degrees: to the right, down in front of the camera, right side up.

    Returns
    -------
    array [h, w, 3], float32
        Each texel is the mean radiance over its solid angle.

    Raises
    ------
    InputError
        The map is no environment map, not finite or mostly negative, the monitor's placement is missing, or the shape does not suit.
    """
    array = read_image(map) if _arguments.is_path(map) else _arguments.floats(map, "map")  # type: ignore[arg-type]
    turn = (_arguments.number(yaw, "yaw"), _arguments.number(pitch, "pitch"), _arguments.number(roll, "roll"))
    places = _arguments.texts(placement, "placement")
    if field is not None:
        if not isinstance(field, Field):
            _arguments.refuse("field", field, "a Field")
        if shape is not None:
            raise InputError("shape: the field has a light map of its own; omit it")
        return _refield.environment_of_field(array, field._native, places, turn)
    if not isinstance(shape, (list, tuple)) or len(shape) not in (2, 3):
        raise InputError("give a field, or the shape (height, width) of the light map")
    return _refield.environment(array, _arguments.whole(shape[0], "shape"), _arguments.whole(shape[1], "shape"),
                                _arguments.text(parameterisation, "parameterisation"), places, turn)


from . import dynamic  # noqa: E402
from .evaluation import Evaluation, evaluate  # noqa: E402
