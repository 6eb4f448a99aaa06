"""Verdicts as JUnit XML: one suite for each folder, one case for each take, one failure for all its breaches."""

import re
from collections.abc import Sequence
from pathlib import Path
from xml.etree import ElementTree

from mocapclean.pipeline.outcome import Verdict

_NOT_XML = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


def junit(verdicts: Sequence[Verdict], preset: str | None = None) -> bytes:
    """Return the XML document, in the form that Jenkins, GitLab and GitHub's viewers read (one ``failure`` a case).

    preset: the name of the preset of limits, for the name of the document.
    """
    name = f"mocapclean check, preset {preset}" if preset else "mocapclean check"
    root = ElementTree.Element("testsuites", _totals(name, verdicts))
    folders: dict[Path, list[Verdict]] = {}
    for verdict in verdicts:
        folders.setdefault(verdict.source.parent, []).append(verdict)
    for folder, takes in folders.items():
        suite = ElementTree.SubElement(root, "testsuite", _totals(str(folder), takes))
        for take in takes:
            _case(suite, take)
    ElementTree.indent(root)
    document: bytes = ElementTree.tostring(root, encoding="utf-8", xml_declaration=True)
    return document + b"\n"


def _totals(name: str, verdicts: Sequence[Verdict]) -> dict[str, str]:
    return {
        "name": _clean(name),
        "tests": str(len(verdicts)),
        "failures": str(sum(not verdict.passes for verdict in verdicts)),
        "errors": "0",
        "skipped": "0",
        "time": f"{sum(verdict.seconds for verdict in verdicts):.3f}",
    }


def _case(suite: ElementTree.Element, verdict: Verdict) -> None:
    case = ElementTree.SubElement(
        suite,
        "testcase",
        {
            "name": _clean(verdict.source.name),
            "classname": _clean(str(verdict.source.parent)),
            "file": _clean(str(verdict.source)),
            "time": f"{verdict.seconds:.3f}",
        },
    )
    if verdict.measures:
        properties = ElementTree.SubElement(case, "properties")
        for name, value in verdict.measures.items():
            ElementTree.SubElement(properties, "property", {"name": name, "value": f"{value:g}"})
    if not verdict.passes:
        limits = ", ".join(dict.fromkeys(breach.limit for breach in verdict.breaches))
        lines = [f"{breach.message}. To do: {breach.advice}." for breach in verdict.breaches]
        failure = ElementTree.SubElement(case, "failure", {"message": _clean(lines[0]), "type": _clean(limits)})
        failure.text = _clean("\n".join(lines))


def _clean(text: str) -> str:
    """Return the text with "?" for characters that XML cannot hold."""
    return _NOT_XML.sub("?", text)
