"""The terminal report: the record of a take in a few aligned lines."""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from mocapclean.errors import printable
from mocapclean.evaluation.metrics import GRADES, Error
from mocapclean.formats.declarations import DECLARATIONS
from mocapclean.pipeline.conversion import Conversion
from mocapclean.pipeline.outcome import Candidate, GapReport, Outcome, Verdict
from mocapclean.take import Finding

_LABEL_WIDTH = 12  # characters of the left column
_FEW_NAMES = 4  # most names of a list in one line
_ERROR_COLUMNS = ("RMSE mm", "3D mm", "largest mm")


def summary(outcome: Outcome, *, verbose: bool = False, report: Path | None = None) -> str:
    """Return the report of one repaired (or failed) take; with ``verbose``, every gap and finding too."""
    if outcome.status == "failed":
        return "\n".join(map(printable, [f"{outcome.source}", _line("failed", outcome.error)]))
    lines = [
        f"{outcome.source} -> {outcome.output}",
        _line("take", _shape(outcome)),
        *_judged(outcome),
        *_untrusted(outcome),
        *_chosen(outcome),
        _line("filled", _filled(outcome)),
        *_replaced(outcome),
        *_left(outcome),
        *_expected(outcome),
        *_self_check(outcome),
        *_learnt_from(outcome),
        *_accuracy(outcome),
        *_stored(outcome),
        *_contacts(outcome),
        *_outdated(outcome),
        *_bones(outcome),
        *_findings(outcome.findings, outcome.first_frame, verbose),
    ]
    if verbose and outcome.gaps:
        lines += ["", *_gap_table(outcome)]
    if outcome.error:
        lines.append(_line("failed", outcome.error))
    places = [f"{what} in {path}" for what, path in (("report", report), ("arrays", outcome.sidecar)) if path]
    closing = ", ".join([f"{outcome.seconds:.1f} s", *places])
    return "\n".join(map(printable, [*lines, _line("done", closing)]))


def inspection(outcome: Outcome, *, verbose: bool = False) -> str:
    """Return the size of a take, its findings and where its gaps are; with ``verbose``, every gap too."""
    lines = [
        f"{outcome.source}",
        _line("take", _shape(outcome)),
        *_judged(outcome),
        *_untrusted(outcome),
        *_bones(outcome),
        *_findings(outcome.findings, outcome.first_frame, verbose),
    ]
    if outcome.gaps:
        lines += ["", *_marker_table(outcome)]
        if verbose:
            lines += ["", *_gap_table(outcome)]
    return "\n".join(map(printable, lines))


def converted(done: Conversion) -> str:
    """Return the report of one converted take: its size, and what the new file does not have."""
    last = done.first_frame + done.n_frames - 1
    shape = f"{_count(done.n_markers, 'marker')} x {_count(done.n_frames, 'frame')} ({done.first_frame}-{last})"
    lines = [
        f"{done.source} -> {done.output}",
        _line("take", f"{done.read_as.upper()} to {done.written_as.upper()}, {shape} at {done.rate:g} Hz"),
        _line("missing", f"{done.missing:,} samples" if done.missing else "nothing"),
        *(_line("left out", text) for text in done.not_carried),
        *_findings(done.findings, done.first_frame, False),
    ]
    return "\n".join(map(printable, lines))


def totals(counts: Mapping[str, int], n_beyond: int, n_earlier: int, report: Path | None) -> str:
    """Return one line about a run: how many takes have each status.

    n_beyond: takes with more samples left than --max-left. n_earlier: takes that an earlier run had done.
    """
    parts = ", ".join(f"{count:,} {status}" for status, count in sorted(counts.items()))
    line = _count(sum(counts.values()), "take") + (f": {parts}" if parts else "")
    line += f"; {n_beyond:,} with more samples left than --max-left" if n_beyond else ""
    line += f"; {n_earlier:,} done before" if n_earlier else ""
    return printable(line + (f"; report in {report}" if report else ""))


def verdict(take: Verdict, *, verbose: bool = False) -> str:
    """Return one line about a checked take: that it passes, or the worst breach of each limit.

    With ``verbose``, every breach has a line of its own, with advice.
    """
    if take.passes:
        frames = "frames {}-{}".format(*take.judged) if take.judged else _count(take.n_frames, "frame")
        shape = f"{_count(take.n_markers, column(take.format))} x {frames}"
        missing, distrusted = take.measures["missing"], take.measures["distrusted"]
        return f"pass  {take.source}: {shape}, {missing:.2f} % missing, {distrusted:.2f} % distrusted or suspicious"
    if verbose:
        return "\n".join([f"FAIL  {take.source}", *(f"      {one.message}; {one.advice}" for one in take.breaches)])
    worst_of_each = (f"{worst.message}{f' (and {n - 1} more)' if n > 1 else ''}" for worst, n in take.worst)
    return f"FAIL  {take.source}: {'; '.join(worst_of_each)}"


def table(rows: Sequence[Sequence[str]], header: Sequence[str]) -> list[str]:
    """Return the lines of a table: the first column aligned left, columns of numbers aligned right."""
    cells = [list(header), *(list(row) for row in rows)]
    widths = [max(len(row[k]) for row in cells) for k in range(len(header))]
    numeric = [
        k > 0 and all(row[k][:1].isdigit() or row[k] in ("", "-") for row in cells[1:]) for k in range(len(header))
    ]
    return [
        "  " + "  ".join(c.rjust(w) if n else c.ljust(w) for c, w, n in zip(row, widths, numeric, strict=True)).rstrip()
        for row in cells
    ]


def _line(label: str, text: str) -> str:
    return f"  {label:<{_LABEL_WIDTH}}{text}"


def _count(number: int, word: str) -> str:
    """Return a number with its noun, in the plural but for 1."""
    return f"{number:,} {word}{'' if number == 1 else 's'}"


def column(format_name: str) -> str:
    """Return what the samples of a format are of: "marker" or "joint"."""
    facts = DECLARATIONS.get(format_name)
    return "joint" if facts and facts.columns == "joints" else "marker"


def _shape(outcome: Outcome) -> str:
    first, last = outcome.first_frame, outcome.first_frame + outcome.n_frames - 1
    seconds = outcome.n_frames / outcome.rate
    columns = _count(outcome.n_markers, column(outcome.format))
    return (
        f"{outcome.format.upper()}, {columns} x {_count(outcome.n_frames, 'frame')} "
        f"({first}-{last}) at {outcome.rate:g} Hz, {seconds:.1f} s"
    )


def _judged(outcome: Outcome) -> Iterable[str]:
    """Yield which frames are judged and counted, where these are not all."""
    if outcome.judged is not None and outcome.counts is not None:
        first, last = outcome.judged
        outside = f"the {outcome.counts.outside:,} samples outside stay as they are and are not counted"
        yield _line("frames", f"{first}-{last} alone; {outside}")


def _untrusted(outcome: Outcome) -> Iterable[str]:
    """Yield the missing, the distrusted and the suspicious samples, each in a line of its own."""
    counts = outcome.counts
    assert counts is not None
    if not counts.missing:
        yield _line("missing", "nothing")
    for label, number, gaps in (
        ("missing", counts.missing, [gap for gap in outcome.gaps if "missing" in gap.rules]),
        (
            "distrusted",
            counts.untrusted - counts.missing,
            [gap for gap in outcome.gaps if set(gap.rules) - {"missing"}],
        ),
    ):
        if number:
            longest = _count(max(gap.stop - gap.start for gap in gaps), "frame")
            share = f"{100 * number / counts.samples:.2f} %"
            rules = _rules(Counter(rule for gap in gaps for rule in gap.rules if rule != "missing"))
            where = f"{_count(number, 'sample')} ({share}) in {_count(len(gaps), 'gap')}"
            yield _line(label, f"{where}{rules}, longest {longest}")
    if counts.suspicious:
        suspicions = [finding for finding in outcome.findings if finding.suspicion]
        rules = _rules(Counter(finding.rule for finding in suspicions))
        found = f"{_count(counts.suspicious, 'measured sample')} in {_count(len(suspicions), 'finding')}{rules}"
        yield _line("suspicious", f"{found}, left as measured; --replace suspicious fills them")


def _rules(numbers: Counter[str]) -> str:
    """Return the numbers of findings by rule, in brackets, or "" without any."""
    return f" ({', '.join(f'{rule} {number}' for rule, number in numbers.items())})" if numbers else ""


def _chosen(outcome: Outcome) -> Iterable[str]:
    """Yield the method that auto chose, and the results of its candidates."""
    choice = outcome.choice
    if choice is None or not (outcome.counts and outcome.counts.untrusted):
        return
    yield _line("method", f"{choice.method}, chosen by auto: {choice.because}")
    rows = [[candidate.method, *_candidate(candidate)] for candidate in choice.candidates]
    yield from _indented(rows, ["candidate", "filled", "RMSE mm", "3D mm", "largest mm"])
    for candidate in choice.candidates:
        if candidate.left_out:
            yield _line("", f"{candidate.method} is left out: {candidate.left_out}")


def _candidate(candidate: Candidate) -> list[str]:
    total = candidate.total
    filled = f"{total.error.samples:,} of {total.samples:,}" if total.error else "-"
    return [filled, *_numbers(total.error)]


def _filled(outcome: Outcome) -> str:
    counts = outcome.counts
    assert counts is not None
    if not counts.untrusted:
        return "nothing to fill" if counts.moved else "nothing to fill; the output is identical to the input"
    facts = outcome.solution
    how = f"by {outcome.method}"
    if facts.get("iterations"):
        state = "converged" if facts.get("converged") else "not converged"
        how += f" ({_count(facts['iterations'], 'iteration')}, {state}: {facts.get('reason')})"
    return f"{_count(counts.filled, 'sample')} {how}"


def _replaced(outcome: Outcome) -> Iterable[str]:
    """Yield how many measured samples were replaced, of how many markers, and by how far at most."""
    if outcome.counts and outcome.counts.replaced:
        replaced = [gap for gap in outcome.gaps if gap.n_replaced]
        number = len({gap.marker for gap in replaced})
        turns = [gap.largest_turn for gap in replaced if gap.largest_turn is not None]
        turned = f" and {max(turns):.1f} degrees" if turns else ""
        samples = _count(outcome.counts.replaced, "measured sample")
        moved = f"by up to {_mm(outcome.largest_move)}{turned}"
        yield _line("replaced", f"{samples} of {_count(number, column(outcome.format))}, {moved}")


def _left(outcome: Outcome) -> Iterable[str]:
    counts = outcome.counts
    assert counts is not None
    if counts.left:
        yield _line("LEFT", f"{_count(counts.left, 'sample')} unfilled")
        reasons = [(number, status.sentence) for status, number in outcome.statuses.items() if status.sentence]
        for number, reason in sorted(reasons, reverse=True):
            yield _line("", f"{number:,} {reason}")
    if counts.moved:
        yield _line("moved", f"{_count(counts.moved, 'trusted sample')}, as asked")
    if counts.invalidated:
        yield _line("invalidated", f"{_count(counts.invalidated, 'sample')} marked missing in the output")


def _expected(outcome: Outcome) -> Iterable[str]:
    """Yield the number of filled gaps of each grade, and the three with the largest expected error."""
    graded = sorted((gap for gap in outcome.gaps if gap.grade), key=lambda gap: -(gap.expected or 0.0))
    if not graded:
        return
    counts = Counter(gap.grade for gap in graded)
    yield _line("expected", ", ".join(f"{_count(counts[name], 'gap')} {name}" for name in GRADES if counts[name]))
    worst = ", ".join(
        f"{gap.marker} {gap.start + outcome.first_frame}-{gap.stop - 1 + outcome.first_frame} {_size(gap)}"
        for gap in graded[:3]
    )
    yield _line("", f"largest error expected in 3D: {worst}")


def _size(gap: GapReport) -> str:
    """Return the expected error of a gap, of a joint with its degrees."""
    degrees = f" ({gap.expected_degrees:.1f} degrees)" if gap.expected_degrees is not None else ""
    return f"{_mm(gap.expected)}{degrees}"


def _learnt_from(outcome: Outcome) -> Iterable[str]:
    for k, each in enumerate(outcome.learnt_from):
        moved = f", but for {', '.join(each.moved)}, placed elsewhere there" if each.moved else ""
        yield _line("" if k else "learnt", f"also from {each.path} (SHA-256 {each.sha256}){moved}")


def _accuracy(outcome: Outcome) -> Iterable[str]:
    if outcome.reference is None:
        return
    if outcome.accuracy is None:
        yield _line("error", f"no filled sample is known in {outcome.reference}")
        return
    yield _line("error", f"{_error(outcome.accuracy)}, against {outcome.reference}")
    rows = [[name, f"{error.samples:,}", *_numbers(error)] for name, error in outcome.accuracy_by_length.items()]
    yield from _indented(rows, ["gap in frames", "samples", *_ERROR_COLUMNS])


def _numbers(error: Error | None) -> list[str]:
    return [f"{error.rmse:.2f}", f"{error.rmse_3d:.2f}", f"{error.largest:.1f}"] if error else ["-", "-", "-"]


def _indented(rows: Sequence[Sequence[str]], header: Sequence[str]) -> Iterable[str]:
    return (_line("", line[2:]) for line in table(rows, header))


def _self_check(outcome: Outcome) -> Iterable[str]:
    """Yield the error on hidden samples of the take itself, by length of gap."""
    checked = outcome.self_check
    if checked is None or not (outcome.counts and outcome.counts.untrusted):
        return
    if checked.because:
        yield _line("self-check", f"not possible: {checked.because}")
        return
    total = checked.total
    hidden = f"{_count(total.samples, 'sample')} hidden in {_count(total.gaps, 'gap')}"
    yield _line("self-check", f"{_error(total.error)}, on {hidden}" if total.error else f"none filled of {hidden}")
    which = " of the gaps in these frames, whole" if outcome.judged else ""
    stands_for = f"it stands for {_share(checked.represented)} of the {_count(total.missing, 'missing sample')}{which}"
    yield _line("", stands_for + ("" if checked.represented == 1.0 else "; the error of the rest is not measured"))
    rows = [
        [
            *(name, f"{check.missing:,}", str(check.gaps), f"{check.samples:,}", *_numbers(check.error)),
            *(_share(check.covered), f"{check.factor:.2f}"),
        ]
        for name, check in checked.by_length.items()
    ]
    header = ["gap in frames", "missing", "hidden in", "samples", *_ERROR_COLUMNS, "within 90 %", "bars x"]
    width = len(header) - 2 * (total.covered is None)
    yield from _indented([row[:width] for row in rows], header[:width])
    if total.error and total.error.samples < total.samples:
        yield _line("", f"{total.samples - total.error.samples:,} of the hidden samples were not filled")


def _share(share: float | None) -> str:
    return "-" if share is None else f"{100 * share:.0f} %"


def _error(error: Error) -> str:
    return f"{error.rmse:.2f} mm per coordinate, {error.rmse_3d:.2f} mm in 3D, largest {error.largest:.1f} mm"


def _stored(outcome: Outcome) -> Iterable[str]:
    """Yield how far the stored poses are from the positions of a method for markers, at most."""
    fitted = [gap for gap in outcome.gaps if gap.fitted is not None]
    if fitted:
        worst = max(fitted, key=lambda gap: gap.fitted or 0.0)
        yield _line("fitted", f"poses within {_mm(worst.fitted)} of the method's positions, farthest at {worst.marker}")


def _contacts(outcome: Outcome) -> Iterable[str]:
    """Yield how many contacts the repair breaks, and the first ones."""
    if outcome.contacts_broken:
        few = ", ".join(f"{joint} {first}-{last}" for joint, first, last in outcome.contacts_broken[:_FEW_NAMES])
        number = _count(len(outcome.contacts_broken), "contact")
        yield _line("contacts", f"{number} broken, where a joint stood still ({few}); --keep-contacts keeps them")


def _outdated(outcome: Outcome) -> Iterable[str]:
    """Yield how many carried points may no longer agree with the markers that they were computed from."""
    if outcome.outdated:
        names = ", ".join(outcome.outdated[:_FEW_NAMES]) + (", ..." if len(outcome.outdated) > _FEW_NAMES else "")
        points = _count(len(outcome.outdated), "carried point")
        yield _line("out of date", f"{points} may follow from repaired markers ({names}); compute them anew")


def _bones(outcome: Outcome) -> Iterable[str]:
    if not outcome.bones:
        yield _line("bones", "none known, and no pair of markers is rigid in this take")
        return
    was, now = outcome.skeleton_rmse
    kind = (
        f"{len(outcome.bones)} from the skeleton"
        if outcome.bones_from == "skeleton"
        else f"{len(outcome.bones)} rigid pairs"
    )
    worst = max(outcome.bones, key=lambda bone: bone.after.deviation or 0.0)
    text = f"{kind}, RMS length error {_mm(was)}"
    if outcome.counts and outcome.counts.filled:
        text += f" before, {_mm(now)} after"
    yield _line("bones", f"{text}; largest {_mm(worst.after.deviation)} in {worst.start} - {worst.end}")


def _mm(value: float | None) -> str:
    return "unknown" if value is None else f"{value:.2f} mm"


def _findings(findings: Sequence[Finding], first: int, verbose: bool) -> Iterable[str]:
    whole = [finding for finding in findings if finding.marker is None or verbose]
    for finding in whole:
        if finding.rule == "missing":
            continue
        where = "" if finding.marker is None else f"{finding.marker}: "
        frames = ""
        if finding.frames is not None:
            frames = f" (frames {finding.frames[0] + first}-{finding.frames[1] - 1 + first})"
        advice = f"; {finding.advice.rstrip('.')}" if finding.advice else ""
        label = "note" if finding.level == "info" else finding.level
        yield _line(label, f"{where}{finding.message.rstrip('.')}{frames}{advice}")


def _marker_table(outcome: Outcome) -> list[str]:
    first, last = outcome.judged or (1, outcome.n_frames)
    by_marker: dict[str, list[GapReport]] = {}
    for gap in outcome.gaps:
        by_marker.setdefault(gap.marker, []).append(gap)
    rows = []
    for marker, gaps in by_marker.items():
        samples = sum(gap.stop - gap.start for gap in gaps)
        longest = max(gaps, key=lambda gap: gap.stop - gap.start)
        span = f"{longest.start + outcome.first_frame}-{longest.stop - 1 + outcome.first_frame}"
        share = f"{100 * samples / (last - first + 1):.1f} %"
        rows.append([marker, str(len(gaps)), str(samples), share, str(longest.stop - longest.start), span])
    rows.sort(key=lambda row: -int(row[2]))
    return table(rows, [column(outcome.format), "gaps", "samples", "share", "longest", "at frames"])


def _gap_table(outcome: Outcome) -> list[str]:
    """Return the table of all gaps, without columns that are empty."""
    first, gaps = outcome.first_frame, outcome.gaps
    columns = {
        column(outcome.format): [gap.marker for gap in gaps],
        "first": [str(gap.start + first) for gap in gaps],
        "last": [str(gap.stop - 1 + first) for gap in gaps],
        "frames": [str(gap.stop - gap.start) for gap in gaps],
        "why": [", ".join(gap.rules) for gap in gaps],
        "what became of it": [gap.status.sentence or ("filled" if gap.n_filled else "-") for gap in gaps],
        "expected 3D mm": ["" if gap.expected is None else f"{gap.expected:.2f}" for gap in gaps],
        "degrees": ["" if gap.expected_degrees is None else f"{gap.expected_degrees:.1f}" for gap in gaps],
        "grade": [gap.grade for gap in gaps],
        "RMSE mm": [f"{gap.error.rmse:.2f}" if gap.error else "" for gap in gaps],
    }
    shown = {name: column for name, column in columns.items() if any(column)}
    return table(list(zip(*shown.values(), strict=True)), list(shown))
