# SPDX-License-Identifier: Apache-2.0
"""Compare estimators with one another on the held-out photographs of a session."""
from __future__ import annotations

import math
import os
import time
from collections.abc import Mapping
from typing import Any, NamedTuple, Optional, Protocol, Union

import numpy as np
import numpy.typing as npt

from . import _arguments
from ._refield import InputError

__all__ = ["Estimator", "Evaluation", "Row", "evaluate"]


class Estimator(Protocol):
    """scikit-learn's convention: light [N, h·w·3] to photographs [N, H·W·3], both flattened in C order."""

    def fit(self, light: Any, observed: Any) -> Any: ...

    def predict(self, light: Any) -> Any: ...


class Row(NamedTuple):
    """One estimator under one kind of held-out light."""

    estimator: str
    kind: str  #: of light
    images: int
    relative_rmse: float  #: over all samples
    median: float  #: of the pixels' relative RMSE
    fit_seconds: float
    predict_ms: float  #: per image

    def __str__(self) -> str:
        return (f"{self.estimator:<20} {self.kind:<10} {self.images:>6} {self.relative_rmse:>13.4f} {self.median:>13.4f} "
                f"{self.fit_seconds:>9.3f} {self.predict_ms:>10.2f}")


_HEADER = f"{'estimator':<20} {'light':<10} {'images':>6} {'relative RMSE':>13} {'median pixel':>13} {'fit in s':>9} {'ms / image':>10}"


class Evaluation(list[Row]):
    """The rows of a comparison; prints as a table, and as one in notebooks."""

    def __str__(self) -> str:
        return "\n".join([_HEADER, *map(str, self)])

    def _repr_html_(self) -> str:
        head = "".join(f"<th>{name}</th>" for name in ("estimator", "light", "images", "relative RMSE", "median pixel",
                                                       "fit in s", "ms per image"))
        body = "".join(f"<tr><td>{row.estimator}</td><td>{row.kind}</td><td>{row.images}</td><td>{row.relative_rmse:.4f}</td>"
                       f"<td>{row.median:.4f}</td><td>{row.fit_seconds:.3f}</td><td>{row.predict_ms:.2f}</td></tr>" for row in self)
        return f"<table><tr>{head}</tr>{body}</table>"

    def chart(self, path: Union[str, "os.PathLike[str]", None] = None) -> Any:
        """Draw error against estimation time, a panel per kind of light; needs Matplotlib.

        Parameters
        ----------
        path : path, optional
            File to write (SVG, PNG, PDF).

        Returns
        -------
        matplotlib.figure.Figure
        """
        from matplotlib import pyplot

        rows = [row for row in self if math.isfinite(row.relative_rmse) and row.relative_rmse > 0.0]  # black light has none
        kinds = list(dict.fromkeys(row.kind for row in rows))
        names = list(dict.fromkeys(row.estimator for row in self))
        colours = [pyplot.get_cmap("tab20")(k) for k in (*range(0, 20, 2), *range(1, 20, 2))]
        columns = min(2, max(1, len(kinds)))
        lines = math.ceil(max(1, len(kinds)) / columns)
        with pyplot.rc_context({"font.size": 8, "axes.titlesize": 9, "axes.grid": True, "grid.color": "#e4e6e9",
                                "axes.axisbelow": True, "legend.fontsize": 7, "svg.fonttype": "none"}):
            figure = pyplot.figure(figsize=(4.2 * columns, 3.2 * lines + 0.3), layout="constrained")
            panels = figure.subplots(lines, columns, squeeze=False).flat
            for axes, kind in zip(panels, kinds):
                for row in rows:
                    if row.kind == kind:
                        k = names.index(row.estimator)
                        axes.plot([row.fit_seconds], [row.relative_rmse], "osD^vP*Xph"[k % 10], markersize=6, linestyle="none",
                                  color=colours[k % 20], label=row.estimator)
                axes.set(title=f"Held-out light: {kind}", xlabel="estimation time in seconds", ylabel="relative RMSE",
                         xscale="log", yscale="log")
            for axes in list(figure.axes)[len(kinds):]:
                axes.remove()
            entries = {label: handle for axes in figure.axes for handle, label in zip(*axes.get_legend_handles_labels())}
            figure.legend(entries.values(), entries.keys(), loc="upper left", bbox_to_anchor=(1.0, 1.0))
            pyplot.close(figure)  # shown where it is returned to, once
            if path is not None:
                figure.savefig(path, bbox_inches="tight")
        return figure


class _Ours:
    """refield itself, from the session, so that sigma and mask count."""

    def __init__(self, session: Any, mode: str) -> None:
        self._session, self._mode = session, mode

    def fit(self, light: Any, observed: Any) -> _Ours:
        from . import estimate

        self._field = estimate(self._session, mode=self._mode)
        return self

    def predict(self, light: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
        return self._field.relight(light.reshape(len(light), *self._field.light_shape)).reshape(len(light), -1)


def _require_numbers(values: npt.NDArray[np.float32], shape: tuple[int, ...], name: str) -> None:
    if values.shape != shape:
        raise InputError(f"{name}: predict() returned the shape {values.shape} for light that has photographs of shape {shape}")
    finite = np.isfinite(values).all(axis=1)
    if not finite.all():
        raise InputError(f"{name}: predict() returned values that are not finite for image {int(np.argmin(finite))}")


def evaluate(session: Any, estimators: Mapping[str, Union[Estimator, str]], progress: Optional[Any] = None) -> Evaluation:
    """Fit estimators to the training frames of a session and compare them on its held-out frames.

    Parameters
    ----------
    session : Session
        With held-out frames (`Session.held_out`). All its images must fit into memory.
    estimators : mapping of names
        To objects with ``fit(light, observed)`` and ``predict(light)`` as in scikit-learn: light [N, h·w·3] and photographs
        [N, H·W·3], float32, each image flattened. Or to a mode of `estimate`, such as "refined" or "paper".
    progress : callable or tqdm bar, optional

    Returns
    -------
    Evaluation
        A list of `Row`, in the order of `estimators`; ``chart()`` draws error against time.

    Raises
    ------
    InputError
        The session has no held-out frame, or a prediction has another shape than the photographs or is not finite.

    Notes
    -----
    Errors are those of `compare`: relative RMSE over measured samples of the mask. ``fit_seconds`` is elapsed time; that of refield
    includes reading the files.
    """
    from . import Session, compare

    if not isinstance(session, Session):
        _arguments.refuse("session", session, "a Session")
    if not isinstance(estimators, Mapping):
        _arguments.refuse("estimators", estimators, "a mapping of names to estimators")
    for name, given in estimators.items():
        if not isinstance(given, str) and not (hasattr(given, "fit") and hasattr(given, "predict")):
            _arguments.refuse(f"estimators[{name!r}]", given, "an object with fit and predict, or a mode of estimate")
    train, test = session.train, session.test
    if not train or not test:
        raise InputError("the session has no held-out frame; hold some out, for example session.held_out(10)")
    light = np.stack([frame.light() for frame in train]).reshape(len(train), -1)
    observed = np.stack([frame.observed() for frame in train]).reshape(len(train), -1)
    by_kind: dict[str, list[Any]] = {}
    for frame in test:
        by_kind.setdefault(frame.kind or "all", []).append(frame)
    held_out = {kind: (np.stack([frame.light() for frame in frames]), np.stack([frame.observed() for frame in frames]),
                       np.stack([np.broadcast_to(np.float32(0) if (sigma := frame.sigma()) is None else sigma, session.shape)
                                 for frame in frames]))
                for kind, frames in by_kind.items()}
    report = _arguments.progress_function(progress)
    rows = Evaluation()
    for place, (name, given) in enumerate(estimators.items()):
        if report is not None:
            report("evaluate", place, len(estimators))
        estimator: Estimator = _Ours(session, given) if isinstance(given, str) else given
        start = time.perf_counter()
        estimator.fit(light, observed)
        fit_seconds = time.perf_counter() - start
        for kind, (new_light, truth, sigma) in held_out.items():
            start = time.perf_counter()
            images = np.asarray(estimator.predict(new_light.reshape(len(new_light), -1)), dtype=np.float32)
            predict_ms = 1e3 * (time.perf_counter() - start) / len(truth)
            _require_numbers(images, (len(truth), truth[0].size), name)
            errors = compare(images.reshape(truth.shape), truth, sigma, session.mask)[0]
            rows.append(Row(name, kind, len(truth), errors.relative_rmse, errors.median, fit_seconds, predict_ms))
    if report is not None:
        report("evaluate", len(estimators), len(estimators))
    return rows
