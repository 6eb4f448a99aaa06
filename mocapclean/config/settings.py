"""YAML and command line -> frozen Settings; what is unknown or mistyped is refused with its place."""

import json
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from difflib import get_close_matches
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
from pydantic_core import ErrorDetails
from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedMap, CommentedSeq
from ruamel.yaml.error import YAMLError

from mocapclean.detection import RULES
from mocapclean.errors import ConfigError
from mocapclean.evaluation.self_check import Params as Hiding
from mocapclean.parameters import STRICT
from mocapclean.solvers import AUTO_CANDIDATES, SOLVERS

DEFAULT_METHOD = "kriging"
CHECKED = ("auto", *(name for name, module in SOLVERS.items() if module.TRAITS.self_checked))
"""The methods whose error on hidden samples is measured with ``self_check: auto``."""
_MOST_VALUES = 10_000
MILLIMETRES = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "in": 25.4}

_SECTION = ConfigDict(**STRICT, frozen=True)
_PATHS = ("skeleton", "dictionary", "gaps", "reference", "output", "out_dir", "report", "sidecar")

_NO_MATTER = {
    *("output", "out_dir", "sidecar", "overwrite", "report", "include_files", "exclude_files", "quiet", "verbose"),
    *("workers", "timeout", "memory", "scheduler"),
}


def _section(name: str, modules: Mapping[str, Any]) -> Any:
    """Return a section with one key for each module, holding the module's ``Params``."""
    keys: dict[str, Any] = {
        key: (module.Params, Field(default_factory=module.Params)) for key, module in modules.items()
    }
    return create_model(name, __config__=_SECTION, **keys)


def _bytes(value: Any) -> int:
    try:
        return TypeAdapter(ByteSize).validate_python(value)
    except ValidationError:
        raise ValueError("a number of bytes, or one with a unit such as 512MB or 2GiB") from None


Methods = _section("Methods", SOLVERS)
Trust = _section("Trust", RULES)


class Grades(BaseModel):
    """The largest expected 3D error of a gap, mm, that earns a grade of ``GRADES``; above both it is poor."""

    model_config = _SECTION

    good: PositiveFloat = 10.0
    fair: PositiveFloat = 30.0

    def of(self, expected: float) -> str:
        """The grade of a gap with this expected 3D error, mm."""
        return next((name for name, limit in (("good", self.good), ("fair", self.fair)) if expected <= limit), "poor")


class Auto(BaseModel):
    """The candidates of method auto, in the order in which they are tried."""

    model_config = _SECTION

    methods: tuple[Literal[tuple(SOLVERS)], ...] = AUTO_CANDIDATES  # type: ignore[valid-type]


class MarkerLimits(BaseModel):
    """What markers of a name may be at most; shares are percentages of the frames."""

    model_config = _SECTION

    longest_gap: PositiveInt | None = Field(default=None, description="frames missing in a row")
    missing: NonNegativeFloat | None = Field(default=None, description="% missing in the file")
    distrusted: NonNegativeFloat | None = Field(default=None, description="% that rules distrust")


class Limits(MarkerLimits):
    """What ``mocapclean check`` asks of a take; what is not given is not asked."""

    markers: dict[str, MarkerLimits] = Field(default={}, description="limits by marker; wildcards allowed")
    required: tuple[str, ...] = Field(default=(), description="markers that must be there and seen; wildcards allowed")
    swaps: NonNegativeInt | None = Field(default=0, description="pairs of swapped markers")
    bone_deviation: PositiveFloat | None = Field(
        default=None, description="mm that a bone's length leaves its reference"
    )
    rates: tuple[PositiveFloat, ...] = Field(default=(), description="Hz, the frame rates allowed; none: any")
    units: bool = Field(default=True, description="size and speed must be those of a body in the stated unit")
    shortest: PositiveFloat | None = Field(default=None, description="seconds")
    longest: PositiveFloat | None = Field(default=None, description="seconds")
    expected_error: PositiveFloat | None = Field(
        default=None, description="3D mm of the method on hidden samples of the take; computed only when given"
    )


class Settings(BaseModel):
    """Every option of the command. Lengths are millimetres, times are frames."""

    model_config = _SECTION

    method: Literal[(*SOLVERS, "auto")] = DEFAULT_METHOD  # type: ignore[valid-type]
    auto: Auto = Field(default_factory=Auto)
    methods: Methods = Field(default_factory=Methods)  # type: ignore[valid-type]
    detect: bool = Field(default=True, description="look for samples that cannot be trusted")
    trust: Trust = Field(default_factory=Trust)  # type: ignore[valid-type]
    fix_swaps: bool = Field(default=False, description="exchange swapped labels back instead of distrusting them")
    check: Limits = Field(default_factory=Limits)
    skeleton: Path | None = Field(default=None, description=".asf or .bvh with joints and bones")
    dictionary: Path | None = Field(default=None, description="of 'mocapclean train', for llc and srmmp")
    rate: PositiveFloat | None = Field(default=None, description="frames per second, for files that do not say")
    unit: Literal["mm", "cm", "m", "in"] | PositiveFloat | None = Field(
        default=None,
        description="unit of length of a BVH file: mm, cm (default), m, in, or millimetres per unit",
    )
    gaps: Path | None = Field(default=None, description="CSV of distrusted spans: marker,first,last")
    max_gap: PositiveInt | None = Field(default=None, description="leave gaps of more frames than this")
    max_error: PositiveFloat | None = Field(
        default=None, description="leave gaps with a larger expected 3D error than this, mm"
    )
    grades: Grades = Field(default_factory=Grades)
    self_check: Literal["auto"] | bool = Field(
        default="auto", description="measure the error on hidden trusted samples; auto: for the methods in CHECKED"
    )
    hiding: Hiding = Field(default_factory=Hiding)
    max_left: Annotated[str | int, Field(union_mode="left_to_right")] | None = Field(
        default=None, description="fail a take with more samples left: a number, or a percentage such as 2%"
    )
    markers: tuple[str, ...] = Field(default=(), description="markers to repair; wildcards allowed")
    exclude: tuple[str, ...] = Field(default=(), description="markers to leave out altogether")
    invalidate: bool = Field(default=False, description="mark as missing (C3D) what is distrusted and not filled")
    reference: Path | None = Field(default=None, description="the true take, for RMSE")
    output: Path | None = Field(default=None, description="the repaired file, for one input")
    out_dir: Path | None = Field(default=None, description="folder for the repaired files")
    sidecar: Path | None = Field(default=None, description="arrays as .npz: a file for one input, or a folder")
    overwrite: bool = Field(default=False, description="replace outputs that exist")
    report: bool | Path = Field(default=True, description="where the report goes, or false for none")
    workers: PositiveInt | Literal["auto"] = Field(default=1, description="takes at a time; auto: one per processor")
    timeout: PositiveFloat | None = Field(default=None, description="seconds that one take may need")
    memory: Annotated[PositiveInt, BeforeValidator(_bytes)] | None = Field(
        default=None, description="memory that one take may need: bytes, or with a unit such as 2GiB"
    )
    scheduler: str | None = Field(default=None, description="address of a Dask cluster that does the work")
    include_files: tuple[str, ...] = Field(default=(), description="only files that match; wildcards allowed")
    exclude_files: tuple[str, ...] = Field(default=(), description="no files that match; wildcards allowed")
    quiet: bool = Field(default=False, description="print nothing but errors")
    verbose: bool = Field(default=False, description="print every gap, bone and finding")

    @property
    def params(self) -> Any:
        """The chosen method's parameters."""
        return getattr(self.methods, self.method)

    @property
    def rules(self) -> dict[str, Any]:
        """The trust rules to run, by name."""
        names = RULES if self.detect else ("missing",)
        return {name: getattr(self.trust, name) for name in names}

    @property
    def identity(self) -> dict[str, Any]:
        """What decides how a take is repaired, as JSON values; not where the result goes or who does the work."""
        return self.model_dump(mode="json", exclude=_NO_MATTER)

    def absolute(self) -> "Settings":
        """The same settings for another machine that shares the storage: with absolute paths."""
        paths = {name: Path(os.path.abspath(value)) for name, value in self if isinstance(value, Path)}
        return self.model_copy(update=paths)

    @property
    def unit_mm(self) -> float | None:
        """Millimetres per unit of length, if the user said so."""
        return MILLIMETRES[self.unit] if isinstance(self.unit, str) else self.unit

    @property
    def checks_itself(self) -> bool:
        """Whether the method's error is measured on hidden samples."""
        return self.method in CHECKED if self.self_check == "auto" else self.self_check

    def too_uncertain(self, expected: float | None) -> bool:
        """Whether a gap of this expected 3D error, mm, is to be left."""
        return self.max_error is not None and expected is not None and expected > self.max_error

    def left_limit(self, n_samples: int) -> float | None:
        """The largest number of samples that may be left, or None without a limit."""
        if self.max_left is None:
            return None
        text = str(self.max_left)
        return float(text.rstrip("%")) * (n_samples / 100 if text.endswith("%") else 1)


def resolve(path: Path | None, options: Mapping[str, Any], assignments: Sequence[str] = ()) -> Settings:
    """Settings from a YAML file, then the command's options, then ``--set`` assignments; the later wins.

    options: values by key. assignments: "name=value" for a parameter of the chosen method, "a.b=value" for anything.
    Paths in the file are relative to its folder. Raises ConfigError with every fault, its file, line and key.
    """
    tree = _load(path) if path else CommentedMap()
    try:
        plain = _plain(tree, iter(range(_MOST_VALUES)))
    except (StopIteration, RecursionError):
        raise ConfigError(f"{path}: a configuration must have fewer than {_MOST_VALUES:,} values.") from None
    if path:
        for key in _PATHS:
            if isinstance(plain.get(key), str):
                plain[key] = path.parent / plain[key]
    plain.update(options)
    for assignment in assignments:
        _assign(plain, assignment)
    try:
        # Strict JSON takes mappings for sections and text for paths, but no text for numbers: just what YAML needs.
        settings = Settings.model_validate_json(json.dumps(plain, default=str))
    except ValidationError as invalid:
        faults = [_sentence(fault, path, tree) for fault in _distinct(invalid)]
        raise ConfigError("\n".join(faults)) from None
    contradictions = [f"{path or 'command line'}: {fault}" for fault in _contradictions(settings)]
    if contradictions:
        raise ConfigError("\n".join(contradictions))
    return settings


def _contradictions(settings: Settings) -> Iterator[str]:
    """What is wrong with values that are each of the right kind."""
    for name, value in settings:
        if isinstance(value, Path) and "\0" in str(value):
            yield f"{name} must be a path, without NUL. Got {str(value)!r}."
    try:
        limit = settings.left_limit(100)
    except ValueError:
        limit = -1.0
    if limit is not None and not 0 <= limit < float("inf"):
        yield f"max_left must be a number of samples or a percentage. Got {settings.max_left!r}."
    if settings.grades.good > settings.grades.fair:
        yield f"grades.good must be at most grades.fair, {settings.grades.fair:g}. Got {settings.grades.good:g}."
    methods = settings.auto.methods if settings.method == "auto" else (settings.method,)
    if settings.max_error is not None and not any(SOLVERS[name].TRAITS.error_bars for name in methods):
        bars = ", ".join(name for name, module in SOLVERS.items() if module.TRAITS.error_bars)
        got = ", ".join(methods)
        yield f"max_error must go with a method that gives error bars: {bars}. Got {got}."
    if not settings.auto.methods:
        yield "auto.methods must name at least one method. Got none."
    if settings.method == "auto" and not settings.checks_itself:
        yield "method auto must go with the self-check, by which it chooses. Got self_check false."


def _load(path: Path) -> CommentedMap:
    try:
        tree = YAML(typ="rt").load(path.read_text(encoding="utf-8"))
    except OSError as fault:
        raise ConfigError(f"{path}: cannot be read: {fault.strerror}.") from None
    except UnicodeDecodeError as fault:
        raise ConfigError(f"{path}, byte {fault.start}: a configuration must be UTF-8 text.") from None
    except YAMLError as fault:
        mark = getattr(fault, "problem_mark", None)
        line = f", line {mark.line + 1}" if mark else ""
        problem = getattr(fault, "problem", None) or str(fault).splitlines()[0]
        raise ConfigError(f"{path}{line}: not valid YAML: {problem}.") from None
    except RecursionError:
        raise ConfigError(f"{path}: not valid YAML: it is nested too deeply.") from None
    except ValueError as fault:
        raise ConfigError(f"{path}: not valid YAML: {fault}.") from None
    if tree is None:
        return CommentedMap()
    if not isinstance(tree, CommentedMap):
        raise ConfigError(f"{path}, line 1: a configuration must be a mapping of keys to values.")
    return tree


def _plain(node: Any, budget: Iterator[int]) -> Any:
    """A node as plain values; each takes one of a budget, for aliases can make few lines stand for very many."""
    next(budget)
    if isinstance(node, CommentedMap):
        return {str(key): _plain(value, budget) for key, value in node.items()}
    if isinstance(node, CommentedSeq):
        return [_plain(item, budget) for item in node]
    for kind in (bool, int, float, str):
        if isinstance(node, kind):
            return kind(node)
    return node


def _assign(plain: dict[str, Any], assignment: str) -> None:
    name, equals, text = assignment.partition("=")
    if not equals or not name:
        raise ConfigError(f"--set must be name=value. Got {assignment!r}.")
    try:
        value = YAML(typ="safe", pure=True).load(text) if text else ""
    except (YAMLError, ValueError, RecursionError):
        value = text
    keys = name.split(".") if "." in name else ["methods", str(plain.get("method", DEFAULT_METHOD)), name]
    branch = plain
    for key in keys[:-1]:
        branch = branch.setdefault(key, {})
        if not isinstance(branch, dict):
            raise ConfigError(f"--set {assignment}: {key!r} is a value, not a section.")
    branch[keys[-1]] = value


def _distinct(invalid: ValidationError) -> Iterable[ErrorDetails]:
    """One fault for each place: of a value that fits no branch of a union, all that it might have been."""
    faults: dict[tuple[str, ...], ErrorDetails] = {}
    for fault in invalid.errors(include_url=False):
        place = tuple(_keys(fault["loc"]))
        if place in faults:
            faults[place]["msg"] += f" or {fault['msg'].removeprefix('Input should be ')}"
        else:
            faults[place] = fault
    return faults.values()


def _keys(place: tuple[int | str, ...]) -> Iterator[str]:
    """The part of a fault's place that consists of keys of the settings."""
    section: Any = Settings
    for key in place:
        fields = _fields(section)
        if fields is None and isinstance(key, str):
            return  # the name of a branch of a union
        yield str(key)
        if not fields or str(key) not in fields:
            return
        section = fields[str(key)].annotation


def _fields(section: Any) -> Mapping[str, Any] | None:
    """The keys of a section, maybe none; None for a value."""
    return getattr(section, "model_fields", None) or getattr(section, "__pydantic_fields__", None)


def _sentence(fault: ErrorDetails, path: Path | None, tree: CommentedMap) -> str:
    keys = list(_keys(fault["loc"]))
    line = _line(tree, keys)
    source = f"{path}, line {line}" if line else "command line"
    name = ".".join(keys)
    if fault["type"] in ("extra_forbidden", "unexpected_keyword_argument"):
        section: Any = Settings
        for key in keys[:-1]:
            section = (_fields(section) or {})[key].annotation
        allowed = sorted(_fields(section) or ())
        near = get_close_matches(keys[-1], allowed, n=1)
        hint = f" Did you mean {near[0]!r}?" if near else ""
        return f"{source}: unknown key {name!r}.{hint} Allowed: {', '.join(allowed) or 'none'}."
    message = fault["msg"].removeprefix("Input should be ").removeprefix("Value error, ")
    return f"{source}: {name} must be {message}. Got {fault['input']!r}."


def _line(tree: Any, keys: Sequence[str]) -> int | None:
    """The line of the deepest of these keys that the file holds all the way down."""
    line = None
    for key in keys:
        if not isinstance(tree, CommentedMap) or key not in tree:
            return line if line and not isinstance(tree, CommentedMap) else None
        line = tree.lc.key(key)[0] + 1
        tree = tree[key]
    return line
