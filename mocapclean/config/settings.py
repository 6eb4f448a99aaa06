"""Every option of the command with its type, unit and default, as frozen settings."""

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import (
    BaseModel,
    BeforeValidator,
    ByteSize,
    ConfigDict,
    Field,
    NonNegativeFloat,
    NonNegativeInt,
    PositiveFloat,
    PositiveInt,
    TypeAdapter,
    ValidationError,
    create_model,
)

from mocapclean.detection import RULES
from mocapclean.evaluation.self_check import Params as HidingParams
from mocapclean.parameters import STRICT
from mocapclean.solvers import AUTO_CANDIDATES, SOLVERS

DEFAULT_METHOD = "kriging"
CHECKED = ("auto", *(name for name, module in SOLVERS.items() if module.TRAITS.self_checked))
"""The methods whose error on hidden samples is measured with ``self_check: auto``."""

MILLIMETRES = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "in": 25.4, "ft": 304.8}
"""Millimetres per unit of length; the inch is 25.4 mm by definition, and a foot is 12 inches."""

_SECTION = ConfigDict(**STRICT, frozen=True)

_NO_EFFECT_ON_REPAIR = {
    *(
        "output",
        "out_dir",
        "sidecar",
        "overwrite",
        "report",
        "html",
        "include_files",
        "exclude_files",
        "quiet",
        "verbose",
    ),
    *("workers", "timeout", "memory", "scheduler"),
}
"""Options that choose takes, places and resources. The repaired samples do not depend on them."""


def _section(name: str, modules: Mapping[str, Any]) -> Any:
    """Return a model of a section with one key per module, whose value is the module's ``Params``."""
    keys: dict[str, Any] = {
        key: (module.Params, Field(default_factory=module.Params)) for key, module in modules.items()
    }
    return create_model(name, __config__=_SECTION, **keys)


def _bytes(value: Any) -> int:
    """Return a size in bytes, given as a number or as text with a unit."""
    try:
        return TypeAdapter(ByteSize).validate_python(value)
    except ValidationError:
        raise ValueError("a number of bytes, or one with a unit such as 512MB or 2GiB") from None


Methods = _section("Methods", SOLVERS)
Trust = _section("Trust", RULES)


class Grades(BaseModel):
    """The largest expected 3D error of a gap, mm, for the grades good and fair. Larger errors are graded poor."""

    model_config = _SECTION

    good: PositiveFloat = 10.0
    fair: PositiveFloat = 30.0

    def of(self, expected: float) -> str:
        """Return the grade of a gap with this expected 3D error, mm."""
        return next((name for name, limit in (("good", self.good), ("fair", self.fair)) if expected <= limit), "poor")


class Auto(BaseModel):
    """The candidates of method auto, in the order in which they are tried."""

    model_config = _SECTION

    methods: tuple[Literal[tuple(SOLVERS)], ...] = AUTO_CANDIDATES  # type: ignore[valid-type]


class MarkerLimits(BaseModel):
    """Limits of ``mocapclean check`` for single markers. Percentages are of the marker's frames."""

    model_config = _SECTION

    longest_gap: PositiveInt | None = Field(default=None, description="frames missing in a row")
    missing: NonNegativeFloat | None = Field(default=None, description="% missing in the file")
    distrusted: NonNegativeFloat | None = Field(default=None, description="% distrusted or suspicious")


class TakeLimits(MarkerLimits):
    """Limits of ``mocapclean check`` for a take. A limit of None is not checked."""

    markers: dict[str, MarkerLimits] = Field(default={}, description="limits by marker; wildcards allowed")
    required: tuple[str, ...] = Field(default=(), description="markers that must be present; wildcards allowed")
    swaps: NonNegativeInt | None = Field(default=0, description="spans of swapped labels")
    bone_deviation: PositiveFloat | None = Field(
        default=None, description="mm between a bone's length and its reference, in the worst frame"
    )
    rates: tuple[PositiveFloat, ...] = Field(default=(), description="frame rates allowed, Hz; none: any")
    units: bool = Field(default=True, description="size and speed must be those of a body in the stated unit")
    shortest: PositiveFloat | None = Field(default=None, description="seconds")
    longest: PositiveFloat | None = Field(default=None, description="seconds")
    expected_error: PositiveFloat | None = Field(
        default=None, description="3D error of the method on hidden samples, mm; costs a fill, so only when given"
    )


class Settings(BaseModel):
    """Every option of the command. Lengths are millimetres, times are frames."""

    model_config = _SECTION

    method: Literal[(*SOLVERS, "auto")] = DEFAULT_METHOD  # type: ignore[valid-type]
    auto: Auto = Field(default_factory=Auto)
    methods: Methods = Field(default_factory=Methods)  # type: ignore[valid-type]
    detect: bool = Field(default=True, description="run the trust rules")
    trust: Trust = Field(default_factory=Trust)  # type: ignore[valid-type]
    fix_swaps: bool = Field(
        default=False, description="exchange swapped labels back instead of distrusting their samples"
    )
    check: TakeLimits = Field(default_factory=TakeLimits)
    skeleton: Path | None = Field(default=None, description=".asf or .bvh file with joints and bones")
    dictionary: Path | None = Field(default=None, description="file of 'mocapclean train', for llc and srmmp")
    rate: PositiveFloat | None = Field(default=None, description="frames per second, for files without a rate")
    unit: Literal["mm", "cm", "m", "in", "ft"] | PositiveFloat | None = Field(
        default=None,
        description="unit of length, in place of the file's own: mm, cm, m, in, ft, or millimetres per unit",
    )
    gaps: Path | None = Field(default=None, description="CSV of distrusted spans: marker,first,last")
    max_gap: PositiveInt | None = Field(default=None, description="gaps of more frames stay unfilled")
    replace: Literal["sure", "suspicious", "missing"] = Field(
        default="sure",
        description="measured samples to replace: those of sure findings, of all findings, or none (only missing ones)",
    )
    max_error: PositiveFloat | None = Field(
        default=None, description="gaps with a larger expected 3D error, mm, stay unfilled; in place of fill_poor"
    )
    fill_poor: bool = Field(
        default=False, description="also fill gaps that are graded poor, or that would bend a rigid pair of markers"
    )
    grades: Grades = Field(default_factory=Grades)
    self_check: Literal["auto"] | bool = Field(
        default="auto", description="measure the error on hidden trusted samples; auto: for the methods in CHECKED"
    )
    hiding: HidingParams = Field(default_factory=HidingParams)
    max_left: Annotated[str | int, Field(union_mode="left_to_right")] | None = Field(
        default=None, description="a take with more unfilled samples fails: a number, or a percentage such as 2%"
    )
    markers: tuple[str, ...] = Field(default=(), description="markers to repair; wildcards allowed")
    exclude: tuple[str, ...] = Field(default=(), description="markers to ignore: neither repaired nor used")
    invalidate: bool = Field(default=False, description="mark distrusted samples that stay unfilled as missing (C3D)")
    reference: Path | None = Field(default=None, description="the true take, for the RMSE")
    output: Path | None = Field(default=None, description="the repaired file, for one input")
    out_dir: Path | None = Field(default=None, description="folder for the repaired files")
    sidecar: Path | None = Field(default=None, description="arrays as .npz: a file for one input, or a folder")
    overwrite: bool = Field(default=False, description="replace existing outputs")
    html: Path | None = Field(default=None, description="a page with pictures of all takes, to open in a browser")
    report: bool | Path = Field(default=True, description="beside each output; or one file for all takes; or false")
    workers: PositiveInt | Literal["auto"] = Field(
        default=1, description="takes repaired at the same time; auto: one per processor"
    )
    timeout: PositiveFloat | None = Field(default=None, description="seconds; a take that needs longer fails")
    memory: Annotated[PositiveInt, BeforeValidator(_bytes)] | None = Field(
        default=None, description="memory of one take: bytes, or with a unit such as 2GiB"
    )
    scheduler: str | None = Field(default=None, description="address of a Dask cluster that repairs the takes")
    include_files: tuple[str, ...] = Field(default=(), description="only matching files; wildcards allowed")
    exclude_files: tuple[str, ...] = Field(default=(), description="no matching files; wildcards allowed")
    quiet: bool = Field(default=False, description="print errors only")
    verbose: bool = Field(default=False, description="print every gap, bone and finding")

    @property
    def params(self) -> Any:
        """Return the parameters of the chosen method."""
        return getattr(self.methods, self.method)

    @property
    def rules(self) -> dict[str, Any]:
        """Return the parameters of the trust rules to run, by rule name."""
        names = RULES if self.detect else ("missing",)
        return {name: getattr(self.trust, name) for name in names}

    @property
    def identity(self) -> dict[str, Any]:
        """Return all options that the repaired samples depend on, as JSON values."""
        return self.model_dump(mode="json", exclude=_NO_EFFECT_ON_REPAIR)

    def absolute(self) -> "Settings":
        """Return the same settings with absolute paths, for a machine that shares the storage."""
        paths = {name: Path(os.path.abspath(value)) for name, value in self if isinstance(value, Path)}
        return self.model_copy(update=paths)

    @property
    def unit_mm(self) -> float | None:
        """Return millimetres per unit of length; None if the unit is not given."""
        return MILLIMETRES[self.unit] if isinstance(self.unit, str) else self.unit

    @property
    def checks_itself(self) -> bool:
        """Whether the method's error is measured on hidden samples."""
        return self.method in CHECKED if self.self_check == "auto" else self.self_check

    @property
    def largest_error(self) -> float | None:
        """Return the expected 3D error, mm, above which a gap stays unfilled; None without a limit."""
        if self.max_error is not None or self.fill_poor:
            return self.max_error
        return self.grades.fair

    def too_uncertain(self, expected: float | None) -> bool:
        """Whether a gap with this expected 3D error, mm, stays unfilled."""
        limit = self.largest_error
        return limit is not None and expected is not None and expected > limit

    def left_limit(self, n_samples: int) -> float | None:
        """Return the largest number of samples that may stay unfilled; None without a limit."""
        if self.max_left is None:
            return None
        text = str(self.max_left)
        return float(text.rstrip("%")) * (n_samples / 100 if text.endswith("%") else 1)
