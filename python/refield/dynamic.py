# SPDX-License-Identifier: Apache-2.0
"""Scenes with moving objects and area lights, as `refield simulate dynamic`."""
from __future__ import annotations

import os
from typing import Any, Optional, Union

import numpy as np
import numpy.typing as npt

from . import _refield

__all__ = ["Scene"]


class Scene:
    """A moving scene with its precomputed light transport.

    Parameters
    ----------
    path : path
        Scene (docs/reference/scene-files.md).
    mode : {"refined", "paper"}
        "paper": as published by Iwasaki et al. 2007.
    progress, threads
        As in `refield.estimate`; precomputed data are kept in ~/.cache/refield (REFIELD_CACHE=off: not kept).

    Raises
    ------
    InputError, FormatError
        The scene or one of its meshes cannot be used.
    """

    def __init__(self, path: Union[str, "os.PathLike[str]"], mode: str = "refined", *, progress: Any = None,
                 threads: Optional[int] = None) -> None:
        from . import _progress

        self._native = _refield.MovingPictures(path, mode, _progress(progress), threads)

    @property
    def duration(self) -> float:
        """Of the motion, in seconds."""
        return self._native.duration

    def frame(self, time: float, *, bounces: int = 3) -> npt.NDArray[np.float32]:
        """The image [H, W, 3] at a time in seconds, with up to so many indirect bounces; scene-linear radiance."""
        return self._native.frame(time, bounces)
