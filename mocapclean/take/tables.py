"""Takes as labelled arrays and tables of other packages: xarray Datasets, pandas DataFrames, and back.

The Dataset has the layout of poses in the package ``movement`` (https://movement.neuroinformatics.dev): the dimensions
time, space, keypoint and individual, of which a take has one. Needs the extra ``xarray``.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

import numpy as np

from mocapclean.arrays import Bools, Floats
from mocapclean.errors import UsageError
from mocapclean.take.status import Codes, Status, current
from mocapclean.take.take import Finding, Take

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

CONFIDENT_MM = 10.0
"""Millimetres from the truth within which ``confidence`` is the probability of a filled sample: the grade good."""
UNEVEN = 1.5
"""Times of the median step from which a step of the times is said to be uneven: a frame is nearer missing than late."""
_AXES = ("x", "y", "z")
_TRUSTED = (Status.MEASURED, Status.SUSPICIOUS, Status.MOVED)
_SUPPLIED = (Status.FILLED, Status.REPLACED)
_DIMENSIONS = ("time", "space", "keypoint", "individual")
_OLDER_NAMES = {"keypoints": "keypoint", "individuals": "individual"}
"""The names of dimensions in ``movement`` before version 0.16, which many files have."""


def to_xarray(take: Take, codes: Codes | None = None, sd: Floats | None = None) -> "xr.Dataset":
    """Return a take as a Dataset with the variables position, confidence, status and sd.

    codes: (F, M) the status of every sample; None for that of a take in memory. sd: (F, M) mm, or None for NaN.
    position (time, space, keypoint, individual) is mm, NaN where a sample is neither trusted nor filled. confidence is
    1 for a trusted sample and 0 for one without a position. Of a filled one it is the probability that it is within
    10 mm of the truth by its error bar, or NaN without one. status holds ``Status`` numbers, whose names are in its
    attribute ``flag_meanings``. Of a skeleton, status and confidence are those of a joint's position, which hangs on
    the channels of all joints above it too; sd is that of the far end of a filled joint. Raises UsageError without the
    extra.
    """
    xarray = _library("xarray")
    codes = _position_codes(take, current(take) if codes is None else codes)
    sd = np.full(codes.shape, np.nan) if sd is None else np.where(take.filled, sd, np.nan)
    per_sample = ("time", "keypoint", "individual")
    flags = {"flag_values": [s.value for s in Status], "flag_meanings": " ".join(s.code for s in Status)}
    frames = np.arange(len(take))
    dataset: xr.Dataset = xarray.Dataset(
        data_vars={
            "position": (_DIMENSIONS, take.to_numpy().transpose(0, 2, 1)[..., None], {"units": "mm"}),
            "confidence": (per_sample, _confidence(codes, sd)[..., None]),
            "status": (per_sample, codes[..., None], flags),
            "sd": (per_sample, sd[..., None], {"units": "mm"}),
        },
        coords={
            "time": frames / take.rate,
            "space": list(_AXES),
            "keypoint": list(take.markers),
            "individual": ["individual_0"],
            "frame": ("time", frames + take.first_frame),
        },
        attrs={
            "ds_type": "poses",
            "fps": take.rate,
            "time_unit": "seconds",
            "source_software": "mocapclean",
            "source_file": str(take.origin.path) if take.origin else "",
        },
    )
    return dataset


def _position_codes(take: Take, codes: Codes) -> Codes:
    """Return the status (F, M) of the positions: of markers that of the samples, of joints what their channels make it.

    A position that hangs on a filled channel is filled, and one that hangs on a missing channel is missing.
    """
    if take.known is None:
        return codes
    placed, measured = take.placed, take.as_markers().trusted
    own = codes.copy()
    own[measured & ~np.isin(codes, _TRUSTED)] = Status.MEASURED
    own[placed & ~measured & ~np.isin(codes, _SUPPLIED)] = Status.FILLED
    own[~placed & np.isin(codes, (*_TRUSTED, *_SUPPLIED))] = Status.MISSING
    return own


def _confidence(codes: Codes, sd: Floats) -> Floats:
    """Return the confidence (F, M) of ``to_xarray``. codes: the status of the positions.

    The length of an error with the standard deviation σ in each of three coordinates has Maxwell's distribution:
    P(r) = erf(r / (σ √2)) - √(2 / π) (r / σ) exp(-r² / (2 σ²)).
    """
    import scipy

    ratio = CONFIDENT_MM / np.maximum(sd, np.finfo(float).tiny)
    within = scipy.special.erf(ratio / 2**0.5) - (2 / np.pi) ** 0.5 * ratio * np.exp(-np.square(ratio) / 2)
    return np.where(np.isin(codes, _SUPPLIED), within, np.where(np.isin(codes, _TRUSTED), 1.0, 0.0))


def from_xarray(dataset: "xr.Dataset") -> Take:
    """Return the take of a Dataset with the layout of poses in ``movement``, whether it was made here or elsewhere.

    Positions are taken as millimetres. With the variable ``status`` of ``to_xarray`` trusted and filled samples are
    those of the take that it was made from; without it every sample with three finite numbers is trusted. A second
    individual makes the names of markers "individual:keypoint". The names of the space say which axis is which. Times
    that are uneven give a finding. Raises UsageError for another layout, and for times that do not rise.
    """
    if not hasattr(dataset, "data_vars"):
        raise UsageError(f"from_xarray takes a Dataset. Got {type(dataset).__name__}.")
    dataset = dataset.rename({old: new for old, new in _OLDER_NAMES.items() if old in dataset.dims})
    if "position" not in dataset.data_vars:
        raise UsageError(f"a Dataset of poses must have the variable position. Got {_listed(dataset.data_vars)}.")
    if set(dataset["position"].dims) != {*_DIMENSIONS} or dataset.sizes["space"] != len(_AXES):
        got = ", ".join(f"{name} {size}" for name, size in dataset["position"].sizes.items())
        raise UsageError(f"position must have the dimensions time, space (3), keypoint and individual. Got {got}.")
    dataset = _in_axes(dataset)
    per_marker = {"marker": ("individual", "keypoint")}
    positions = dataset["position"].stack(per_marker).transpose("time", "marker", "space").to_numpy().astype(float)
    finite: Bools = np.isfinite(positions).all(axis=2)
    trusted, filled = finite, np.zeros_like(finite)
    if "status" in dataset.data_vars:
        codes = dataset["status"].stack(per_marker).transpose("time", "marker").to_numpy()
        trusted, filled = finite & np.isin(codes, _TRUSTED), finite & np.isin(codes, _SUPPLIED)
    keypoints = [str(name) for name in _names(dataset, "keypoint")]
    people = [str(name) for name in _names(dataset, "individual")]
    markers = keypoints if len(people) == 1 else [f"{person}:{name}" for person in people for name in keypoints]
    return Take(
        positions=np.where(finite[..., None], positions, 0.0),
        trusted=trusted,
        filled=filled,
        moved=trusted & (codes == Status.MOVED) if "status" in dataset.data_vars else None,  # type: ignore[arg-type]
        markers=tuple(markers),
        rate=_rate(dataset),
        first_frame=int(dataset["frame"][0]) if "frame" in dataset.coords and dataset.sizes["time"] else 1,
        findings=_uneven(dataset),
    )


def _in_axes(dataset: "xr.Dataset") -> "xr.Dataset":
    """Return a Dataset with its space in the order x, y, z; as it is where the space has no names."""
    if "space" not in dataset.coords:
        return dataset
    named = [str(name) for name in dataset["space"].to_numpy()]
    if sorted(named) != [*_AXES]:
        raise UsageError(f"the space of a Dataset must be x, y and z. Got {_listed(named)}.")
    return dataset.isel(space=[named.index(axis) for axis in _AXES])


def _uneven(dataset: "xr.Dataset") -> tuple[Finding, ...]:
    """Return a finding where the times of a Dataset are uneven; raise UsageError where they do not rise."""
    if "time" not in dataset.coords or dataset.sizes["time"] < 2:
        return ()
    steps = np.diff(dataset["time"].to_numpy())
    if not (steps > 0).all():
        raise UsageError("the times of a Dataset must rise from frame to frame. Some do not.")
    if steps.max() <= UNEVEN * np.median(steps):
        return ()
    message = f"the times are uneven: the longest step is {steps.max():g}, the median {np.median(steps):g}"
    return (Finding(rule="times", level="warning", message=message),)


def _names(dataset: "xr.Dataset", dimension: str) -> list[Any]:
    """Return the names along a dimension, or its numbers from 0 where it has none."""
    named = dimension in dataset.coords
    return dataset[dimension].to_numpy().tolist() if named else list(range(dataset.sizes[dimension]))


def _rate(dataset: "xr.Dataset") -> float:
    """Return the frames per second that a Dataset states or that its times show; raise UsageError without either."""
    stated = dataset.attrs.get("fps")
    if stated:
        if not isinstance(stated, float | int | np.number) or not 0 < stated < np.inf:
            raise UsageError(f"the attribute fps of a Dataset must be a positive number. Got {stated!r}.")
        return float(stated)
    if dataset.attrs.get("time_unit") != "frames" and "time" in dataset.coords and dataset.sizes["time"] > 1:
        return float(1.0 / np.median(np.diff(dataset["time"].to_numpy())))
    raise UsageError("a Dataset of poses must have its frames per second in the attribute fps. It has none.")


def to_dataframe(take: Take) -> "pd.DataFrame":
    """Return the positions of a take as a wide table: a row for each frame, columns (marker, axis), mm.

    The index is the time in seconds. Numbers are NaN where a sample is neither trusted nor filled. Raises UsageError
    without the extra.
    """
    pandas = _library("pandas")
    table: pd.DataFrame = pandas.DataFrame(
        take.to_numpy().reshape(len(take), -1),
        index=pandas.Index(np.arange(len(take)) / take.rate, name="time"),
        columns=pandas.MultiIndex.from_product([take.markers, _AXES], names=["marker", "axis"]),
    )
    return table


def _library(name: str) -> Any:
    """Return a package of the extra; raise UsageError where it is not installed."""
    try:
        return import_module(name)
    except ImportError:
        message = f"a take as a table needs {name}. Run pip install '.[xarray]' in the clone of mocapclean."
        raise UsageError(message) from None


def _listed(names: Any) -> str:
    return ", ".join(map(str, names)) or "none"
