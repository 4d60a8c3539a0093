# SPDX-License-Identifier: Apache-2.0
"""Scenes with moving objects and area lights, as `refield render`."""
from __future__ import annotations

from typing import Optional

import numpy as np
import numpy.typing as npt

from . import _arguments, _refield
from ._arguments import Path, Progress

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
        As in `refield.estimate`.

    Raises
    ------
    InputError, FormatError
        The scene or one of its meshes cannot be used.
    """

    def __init__(self, path: Path, mode: str = "refined", *, progress: Progress = None,
                 threads: Optional[int] = None) -> None:
        self._native = _refield.MovingPictures(_arguments.path(path), _arguments.text(mode, "mode"),
                                               _arguments.progress_function(progress), _arguments.thread_limit(threads))

    @property
    def duration(self) -> float:
        """Of the motion, in seconds."""
        return self._native.duration

    def frame(self, time: float, *, bounces: int = 3) -> npt.NDArray[np.float32]:
        """Render the scene at one time.

        Parameters
        ----------
        time : float
            In seconds from the start, 0 or more. After `duration` everything stands still.
        bounces : int
            Maximum number of indirect bounces, 0 or more; 0: direct light alone.

        Returns
        -------
        array [H, W, 3], float32
            Scene-linear radiance, of the size that the scene file states.

        Raises
        ------
        InputError
            The time or the number of bounces is out of range.

        Notes
        -----
        Area lights and objects are moved without new precomputation (Iwasaki et al. 2007).
        """
        return self._native.frame(_arguments.number(time, "time"), _arguments.whole(bounces, "bounces"))
