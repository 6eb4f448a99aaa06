"""The words, colours and shapes of the kinds of samples: one vocabulary for pages, figures and the terminal."""

from dataclasses import dataclass

from mocapclean.take.status import MEANINGS, Status


@dataclass(frozen=True)
class Kind:
    """A kind of samples as a reader sees it.

    colour: sRGB. shape: the marker of a scatter plot. hatch: the pattern of an area, "" for none, so that kinds differ
    without colour too. severity: which kind is shown where several share a pixel, larger ones first.
    """

    name: str
    colour: str
    shape: str
    hatch: str
    severity: int


# Colours: Okabe and Ito, Color universal design (2008), which people with any colour vision tell apart.
KINDS = (
    Kind("measured", "#8a9199", "circle", "", 0),
    Kind("filled", "#0072b2", "diamond", "", 2),
    Kind("moved", "#009e73", "triangle", "", 1),
    Kind("suspicious", "#cc79a7", "hex", "dot", 3),
    Kind("replaced", "#e69f00", "square", "right_diagonal_line", 4),
    Kind("missing", "#3f4a56", "x", "", 5),
    Kind("distrusted", "#d55e00", "inverted_triangle", "right_diagonal_line", 6),
    Kind("left", "#d55e00", "x", "cross", 7),
    Kind("outside", "#c8cdd2", "dot", "", -1),
)

_KIND_OF = {
    Status.MEASURED: "measured",
    Status.FILLED: "filled",
    Status.REPLACED: "replaced",
    Status.MOVED: "moved",
    Status.SUSPICIOUS: "suspicious",
    Status.MISSING: "missing",
    Status.DISTRUSTED: "distrusted",
    Status.OUTSIDE: "outside",
}


def kind_of(status: Status) -> str:
    """Return the kind of samples of a status; samples that no method supplied are of the kind "left"."""
    return _KIND_OF.get(status, "left")


def statuses() -> list[dict[str, str]]:
    """Return code, kind and meaning of every status, in the order of their numbers."""
    return [{"code": status.code, "kind": kind_of(status), "meaning": MEANINGS[status]} for status in Status]
