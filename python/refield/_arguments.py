# SPDX-License-Identifier: Apache-2.0
"""Arguments of the package's functions: converted for the extension module, or refused with name, value and remedy."""
from __future__ import annotations

import json
import math
import operator
import os
import reprlib
from collections.abc import Callable, Sequence
from typing import Any, NoReturn, Optional, Union

import numpy as np
import numpy.typing as npt

from ._refield import InputError

Array = npt.NDArray[np.float32]
Path = Union[str, "os.PathLike[str]"]
#: Called with the stage, the work done and the total; or a tqdm bar.
Progress = Union[Callable[[str, int, int], object], Any, None]


def refuse(name: str, value: object, remedy: str) -> NoReturn:
    raise InputError(f"{name} is {reprlib.repr(value)}; give {remedy}")


def rig(value: Any) -> str:
    """ "auto", "off", or a model as JSON."""
    if isinstance(value, dict):
        return json.dumps(value)
    if value in ("auto", "off"):
        return str(value)
    if not is_path(value):
        refuse("rig", value, "'auto', 'off', a model (Field.rig) or the path of one (JSON)")
    try:
        with open(value, encoding="utf-8") as file:
            return file.read()
    except OSError as error:
        raise InputError(f"rig: {value}: {error.strerror}") from None


def whole(value: Any, name: str) -> int:
    """Any integer type; the extension module holds 32 bits."""
    try:
        number = operator.index(value)
    except TypeError:
        refuse(name, value, "a whole number")
    if abs(number) >= 2**31:
        refuse(name, value, "a number of at most 31 bits")
    return number


def number(value: Any, name: str) -> float:
    try:
        result = math.nan if isinstance(value, (str, bytes)) else float(value)
    except (TypeError, ValueError, OverflowError):
        result = math.nan
    if not math.isfinite(result):
        refuse(name, value, "a finite number")
    return result


def flag(value: Any, name: str) -> bool:
    if not isinstance(value, (bool, np.bool_)):
        refuse(name, value, "True or False")
    return bool(value)


def text(value: Any, name: str) -> str:
    if not isinstance(value, str):
        refuse(name, value, "a string")
    return value


def texts(value: Any, name: str) -> list[str]:
    """One, several or None."""
    if value is None or isinstance(value, str):
        return [] if value is None else [value]
    if not isinstance(value, (list, tuple)):
        refuse(name, value, "a string or several")
    return [text(entry, name) for entry in value]


def path(value: Any, name: str = "path") -> str:
    try:
        result = os.fsdecode(value)
        os.fsencode(result)
    except (TypeError, UnicodeError):
        result = ""
    if not result or "\0" in result:
        refuse(name, value, "the path of a file or folder")
    return result


def is_path(value: object) -> bool:
    return isinstance(value, (str, os.PathLike))


def are_paths(value: object) -> bool:
    return isinstance(value, (list, tuple)) and len(value) > 0 and all(is_path(entry) for entry in value)


def paths(value: Any, name: str) -> list[str]:
    if not hasattr(value, "__iter__"):
        refuse(name, value, "a pattern or a sequence of paths")
    return [path(entry, name) for entry in value]


def thread_limit(value: Optional[int]) -> Optional[int]:
    if value is not None and whole(value, "threads") < 0:
        refuse("threads", value, "1 or more, or None for all cores")
    return None if value is None else whole(value, "threads")


def progress_function(progress: Progress) -> Optional[Callable[[str, int, int], object]]:
    """tqdm bars are no functions of a stage."""
    if progress is None or not (hasattr(progress, "set_description") and hasattr(progress, "refresh")):
        return progress
    bar: Any = progress

    def show(stage: str, done: int, total: int) -> None:
        bar.set_description(stage, refresh=False)
        bar.total, bar.n = total, done
        bar.refresh()

    return show


def unmasked(array: Any, name: str, remedy: str) -> None:
    for entry in array if isinstance(array, (list, tuple)) else [array]:
        if isinstance(entry, np.ma.MaskedArray) and np.ma.is_masked(entry):  # type: ignore[no-untyped-call]
            raise InputError(f"{name}: is a masked array, whose mask is not used; {remedy}, or give array.filled(value)")


def floats(array: npt.ArrayLike, name: str) -> Array:
    """float32 as it is; float64 and float16 rounded or widened; uint16 and uint8 such that their largest value is 1."""
    entries = array if isinstance(array, (list, tuple)) else [array]
    unmasked(array, name, "mark unmeasured samples by sigma = inf")
    types = {entry.dtype for entry in entries if isinstance(entry, np.ndarray)}
    if len(types) > 1 and any(kind.kind != "f" for kind in types):
        raise InputError(f"{name}: has images of the types {', '.join(sorted(map(str, types)))}, of which the whole numbers have a "
                         "scale of their own; convert them to one type")
    try:
        given = np.asarray(array)
    except (TypeError, ValueError):
        raise InputError(f"{name}: is no array; give one array, or images of one shape") from None
    if given.dtype == np.float32 and given.dtype.isnative:
        if given.flags.aligned and all(stride % 4 == 0 for stride in given.strides):
            return given
        return np.ascontiguousarray(given)
    if given.dtype.kind == "f":
        with np.errstate(over="ignore"):  # infinite values are refused by name
            rounded = given.astype(np.float32)
        if given.dtype.itemsize > 4 and given.any() and not rounded.any():
            raise InputError(f"{name}: its values are too small for float32; scale them to values around 1")
        return rounded
    if given.dtype.newbyteorder("=") in (np.dtype(np.uint16), np.dtype(np.uint8)):
        return np.multiply(given, np.float32(1.0 / np.iinfo(given.dtype).max), dtype=np.float32)
    raise InputError(f"{name}: has the type {given.dtype}; give float32, float16, float64, uint16 or uint8")


def light_for(out: Optional[Array], light: npt.ArrayLike) -> Array:
    """Light maps that writing into `out` does not change."""
    if out is not None and not isinstance(out, np.ndarray):
        refuse("out", out, "a float32 array in C order")
    array = floats(light, "light")
    return array.copy() if out is not None and np.may_share_memory(array, out) else array


def pixels(mask: Any, shape: Sequence[int]) -> npt.NDArray[np.bool_]:
    """A mask of images [..., height, width, 3]: true, or above one half as in files; whole numbers are 0 and 1, or 0 and the
    largest of their type."""
    unmasked(mask, "mask", "give 0 for pixels that do not count")
    given = np.asarray(mask)
    if given.dtype.kind not in "biuf" or given.shape != tuple(shape[-3:-1]):
        wanted = "×".join(map(str, shape[-3:-1]))
        raise InputError(f"mask: is {given.dtype} of shape {given.shape}; give booleans or numbers of height×width {wanted}")
    if given.dtype.kind == "f" and np.isnan(given).any():
        raise InputError("mask: holds NaN; give 0 for pixels that do not count and 1 for those that do")
    if given.dtype.kind in "iu" and given.size and given.max() > 1 and not np.isin(given, (0, np.iinfo(given.dtype).max)).all():
        raise InputError(f"mask: holds whole numbers such as {given[given > 1].min()}; give booleans, for example mask > 127")
    result: npt.NDArray[np.bool_] = given > 0.5
    if not result.any():
        raise InputError("mask: is nowhere above one half, so that no pixel counts; give 1 for those that do")
    return result
