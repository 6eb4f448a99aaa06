"""Every option of the command with its type, unit and default, as frozen settings."""

import os
from collections.abc import Iterator
from dataclasses import field, fields
from pathlib import Path
from typing import Annotated, Any, Literal

from mocapclean.config.presets import PRESETS
from mocapclean.config.ranges import EventNames, FrameNumbers
from mocapclean.config.sections import Sections
from mocapclean.detection import RULES
from mocapclean.evaluation.self_check import Params as HidingParams
from mocapclean.formats.declarations import DECLARATIONS
from mocapclean.json_values import plain
from mocapclean.parameters import AtLeastOne, Field, NameIn, NotNegative, Positive, but, parameters
from mocapclean.solvers import AUTO_CANDIDATES, SOLVERS
from mocapclean.units import MILLIMETRES

DEFAULT_METHOD = "kriging"
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


class _Bytes:
    """A size in bytes, given as a number or as text with a unit; part of an annotation."""

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> Any:
        from pydantic_core import core_schema

        return core_schema.no_info_before_validator_function(self._number, handler(source))

    def __get_pydantic_json_schema__(self, core_schema: Any, handler: Any) -> Any:
        return {"anyOf": [{"type": "integer", "exclusiveMinimum": 0}, {"type": "string"}]}

    @staticmethod
    def _number(value: Any) -> int:
        from pydantic import ByteSize, TypeAdapter, ValidationError

        try:
            return TypeAdapter(ByteSize).validate_python(value)
        except ValidationError:
            raise ValueError("a number of bytes, or one with a unit such as 512MB or 2GiB") from None


class Methods(Sections):
    """The parameters of every method."""

    modules = SOLVERS


class Trust(Sections):
    """The parameters of every trust rule."""

    modules = RULES


@parameters
class Grades:
    """The largest expected 3D error of a gap, mm, for the grades good and fair. Larger errors are graded poor."""

    good: Positive = 10.0
    """Millimetres."""
    fair: Positive = 30.0
    """Millimetres."""

    def of(self, expected: float) -> str:
        """Return the grade of a gap with this expected 3D error, mm."""
        return next((name for name, limit in (("good", self.good), ("fair", self.fair)) if expected <= limit), "poor")


@parameters
class Auto:
    """The candidates of method auto, in the order in which they are tried."""

    methods: tuple[Annotated[str, NameIn(SOLVERS)], ...] = AUTO_CANDIDATES
    """The candidates, in the order in which they are tried."""


@parameters
class MarkerLimits:
    """Limits of ``mocapclean check`` for single markers. Percentages are of the marker's frames."""

    longest_gap: AtLeastOne | None = None
    """Frames missing in a row."""
    missing: NotNegative | None = None
    """Percentage missing in the file."""
    distrusted: NotNegative | None = None
    """Percentage distrusted or suspicious."""


@parameters
class TakeLimits(MarkerLimits):
    """Limits of ``mocapclean check`` for a take. A limit of None is not checked."""

    preset: Literal[tuple(PRESETS)] | None = None  # type: ignore[valid-type]
    """Limits for a purpose, in the place of those that are left out here; a key with null takes a limit away."""
    longest_gap: AtLeastOne | None = None
    """Frames that a marker may be missing in a row."""
    longest_inner_gap: Positive | None = None
    """Seconds that a marker may be missing in a row, where it is seen before and after."""
    missing: NotNegative | None = None
    """Percentage of all samples that may be missing in the file."""
    distrusted: NotNegative | None = None
    """Percentage of all samples that the trust rules may distrust or report as suspicious."""
    replaced: NotNegative | None = 10.0
    """Percentage of all samples that a fill may replace, because trust rules distrust them."""
    markers: dict[str, MarkerLimits] = field(default_factory=dict)
    """Limits by marker; wildcards allowed."""
    required: tuple[str, ...] = ()
    """Markers that must be present; wildcards allowed."""
    swaps: Annotated[int, Field(ge=0)] | None = 0
    """Spans in which two labels may be swapped."""
    bone_deviation: Positive | None = None
    """Millimetres between a bone's length and its reference, in the worst frame."""
    rates: tuple[Positive, ...] = ()
    """Allowed frame rates, Hz; none: any."""
    units: bool = True
    """Size and speed must be those of a body in the stated unit."""
    shortest: Positive | None = None
    """Seconds that a take must last."""
    longest: Positive | None = None
    """Seconds that a take may last."""
    expected_error: Positive | None = None
    """3D error of the method on hidden samples, mm; costs a fill, so only when given."""


@parameters
class Settings:
    """Every option of the command. Lengths are millimetres, times are frames."""

    method: Annotated[str, NameIn(SOLVERS, "auto")] = DEFAULT_METHOD
    """How to fill: a name from 'mocapclean methods', or auto to choose for each take."""
    auto: Auto = field(default_factory=Auto)
    """How method auto chooses."""
    methods: Methods = field(default_factory=Methods)
    """The parameters of every method: symbol in its equations, unit, meaning."""
    detect: bool = True
    """Run the trust rules."""
    trust: Trust = field(default_factory=Trust)
    """The parameters of every trust rule."""
    fix_swaps: bool = False
    """Exchange swapped labels back instead of distrusting their samples."""
    check: TakeLimits = field(default_factory=TakeLimits)
    """Limits of 'mocapclean check'; one that is null is not checked."""
    skeleton: Path | None = None
    """The .asf or .bvh file with joints and bones."""
    dictionary: Path | None = None
    """File of 'mocapclean train', for llc and srmmp."""
    rate: Positive | None = None
    """Frames per second, for files without a rate."""
    format: Literal[tuple(DECLARATIONS)] | None = None  # type: ignore[valid-type]
    """Format of the takes, where their names and their content do not tell it."""
    unit: Literal["mm", "cm", "m", "in", "ft"] | Positive | None = None
    """Unit of length, in place of the file's own: mm, cm, m, in, ft, or millimetres per unit."""
    gaps: Path | None = None
    """CSV of distrusted spans: marker,first,last."""
    frames: Annotated[str, FrameNumbers()] | None = None
    """Only these frames are judged and repaired, by their numbers in the file: first:last, first: or :last."""
    events: Annotated[str, EventNames()] | None = None
    """Only the frames from the first event of a name to the next one of another name: start:end."""
    max_gap: AtLeastOne | None = None
    """Gaps of more frames stay unfilled."""
    replace: Literal["sure", "suspicious", "missing"] = "sure"
    """Measured samples to replace: those of sure findings, of all findings, or none (only missing ones)."""
    max_error: Positive | None = None
    """Gaps with a larger expected 3D error, mm, stay unfilled; in place of fill_poor."""
    fill_poor: bool = False
    """Also fill gaps that are graded poor, or that would bend a rigid pair of markers."""
    keep_contacts: bool = False
    """Keep joints of skeletons in place that stand still on both sides of a repaired span, such as planted feet."""
    grades: Grades = field(default_factory=Grades)
    """The largest expected 3D error of a gap, for its grade; larger errors are graded poor."""
    self_check: Literal["auto"] | bool = "auto"
    """Measure the error on hidden trusted samples; auto: for method auto, and for methods whose traits ask for it."""
    hiding: HidingParams = field(default_factory=HidingParams)
    """How many samples the self-check hides."""
    max_left: Annotated[str | int, Field(union_mode="left_to_right")] | None = None
    """A take with more unfilled samples fails: a number, or a percentage such as 2%."""
    markers: tuple[str, ...] = ()
    """Markers to repair; wildcards allowed."""
    exclude: tuple[str, ...] = ()
    """Markers to ignore: neither repaired nor used."""
    invalidate: bool = False
    """Mark distrusted samples that stay unfilled as missing (markers)."""
    learn_from: tuple[Path, ...] = ()
    """Other takes of the same subject to learn from: files or folders (kriging, pca, pma)."""
    reference: Path | None = None
    """The true take, for the RMSE."""
    output: Path | None = None
    """The repaired file, for one input."""
    out_dir: Path | None = None
    """Folder for the repaired files."""
    sidecar: Path | None = None
    """Arrays as .npz: a file for one input, or a folder."""
    overwrite: bool = False
    """Replace existing outputs."""
    html: Path | None = None
    """A page with pictures of all takes, to open in a browser."""
    report: bool | Path = True
    """Beside each output; or one file for all takes; or false."""
    workers: AtLeastOne | Literal["auto"] = "auto"
    """Takes repaired at the same time, or cores for a single take; auto: all cores."""
    timeout: Positive | None = None
    """Seconds; a take that needs longer fails."""
    memory: Annotated[int, Field(gt=0), _Bytes()] | None = None
    """Memory of one take: bytes, or with a unit such as 2GiB."""
    scheduler: str | None = None
    """Address of a Dask cluster that repairs the takes."""
    include_files: tuple[str, ...] = ()
    """Only matching files; wildcards allowed."""
    exclude_files: tuple[str, ...] = ()
    """No matching files; wildcards allowed."""
    quiet: bool = False
    """Print errors only."""
    verbose: bool = False
    """Print every gap, bone and finding."""

    @property
    def params(self) -> Any:
        """Return the parameters of the chosen method."""
        return self.methods[self.method]

    @property
    def rules(self) -> dict[str, Any]:
        """Return the parameters of the trust rules to run, by rule name."""
        names = self.trust if self.detect else ("missing",)
        return {name: self.trust[name] for name in names}

    @property
    def identity(self) -> dict[str, Any]:
        """Return all that the repaired samples depend on, as JSON values: options, and packages with own methods."""
        options = {name: value for name, value in self.as_json().items() if name not in _NO_EFFECT_ON_REPAIR}
        packages = {*map(SOLVERS.origin, options["methods"]), *map(RULES.origin, options["trust"])} - {""}
        return options | ({"packages": sorted(packages)} if packages else {})

    def __iter__(self) -> Iterator[tuple[str, Any]]:
        """Yield every option with its value."""
        for option in fields(self):
            yield option.name, getattr(self, option.name)

    def as_json(self) -> dict[str, Any]:
        """Return all options as JSON values; ``methods`` are those that may be used or that the user sets."""
        used = self.auto.methods if self.method == "auto" else (self.method,)
        names = dict.fromkeys((*self.methods, *used))
        methods = {name: self.methods[name] for name in names if name in used or name in self.methods.given}
        return {name: plain(methods if name == "methods" else value) for name, value in self}

    def but(self, **changes: Any) -> "Settings":
        """Return a copy with changed options, whose values are known to be valid."""
        return but(self, **changes)

    def absolute(self) -> "Settings":
        """Return the same settings with absolute paths, for a machine that shares the storage."""
        single = {name: Path(os.path.abspath(value)) for name, value in self if isinstance(value, Path)}
        return self.but(**single, learn_from=tuple(Path(os.path.abspath(path)) for path in self.learn_from))

    @property
    def unit_mm(self) -> float | None:
        """Return millimetres per unit of length; None if the unit is not given."""
        return MILLIMETRES[self.unit] if isinstance(self.unit, str) else self.unit

    @property
    def checks_itself(self) -> bool:
        """Whether the method's error is measured on hidden samples."""
        if self.self_check != "auto":
            return self.self_check
        return self.method == "auto" or SOLVERS[self.method].TRAITS.self_checked

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
