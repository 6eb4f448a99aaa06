"""A mutated input through read, detect, fill and write, which must end in a MocapcleanError or a readable output."""

import random
import signal
import tempfile
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import mocapclean
from mocapclean.config.settings import Settings
from mocapclean.pipeline.repair import repair
from tests.fuzz.mutate import mutate
from tests.table_texts import TEXTS

SECONDS = 5.0
"""Processor seconds that an input may take; chosen by hand."""
LARGEST = 400_000
"""Bytes of the largest file that is mutated."""
LONGEST = 600
"""Lines that are kept of a text."""
KINDS = ("c3d", "c3d", "bvh", "amc", "trc", "csv", "tsv")
"""Suffixes of the inputs, one of which is drawn for each."""
SETTINGS = Settings(method="linear", self_check=False, overwrite=True)


@lru_cache
def corpus(folders: tuple[Path, ...], kind: str) -> list[bytes]:
    """Return the files of a kind (c3d, bvh, amc, asf, trc, ...) in folders, and the texts of tables that are made for
    tests, without large files; long texts are cut.
    """
    paths = {path for folder in folders for path in folder.rglob("*") if path.suffix.lower() == f".{kind}"}
    found = [path.read_bytes() for path in sorted(paths)]
    if kind != "c3d":
        found = [b"".join(content.splitlines(keepends=True)[:LONGEST]) for content in found]
    made = [content for name, content in TEXTS.items() if name.endswith(f".{kind}")]
    return [content for content in found if len(content) <= LARGEST] + made


class HangError(Exception):
    """An input took too much processor time."""


@dataclass(frozen=True)
class Fuzz:
    """Try the input of a seed: "refused" or "repaired", or an exception."""

    folders: tuple[Path, ...]
    found: Path
    kinds: tuple[str, ...] = KINDS

    def __call__(self, seed: int) -> str:
        """Mutate and repair; an input that raises is kept in the folder ``found``."""
        with tempfile.TemporaryDirectory() as place:
            source = self.input(seed, Path(place))
            output = Path(place) / f"out{source.suffix}"
            try:
                with _hurry(), warnings.catch_warnings(action="error", category=RuntimeWarning):
                    outcome = repair(source, output, SETTINGS)
                    if outcome.status == "failed":
                        if "not enough memory" in outcome.error:
                            raise MemoryError
                        assert not output.exists()
                        return "refused"
                    mocapclean.read(output, skeleton=Path(place) / "take.asf" if source.suffix == ".amc" else None)
            except BaseException:
                for path in Path(place).glob("take.*"):
                    self.found.mkdir(parents=True, exist_ok=True)
                    (self.found / f"{seed}{path.suffix}").write_bytes(path.read_bytes())
                raise
            return "repaired"

    def undo(self, seed: int) -> None:
        """Do nothing: what a lost process leaves is in a temporary folder."""

    def input(self, seed: int, place: Path) -> Path:
        """Return the mutated file of a seed, in a folder, made from the smaller of two files to save time."""
        rng = random.Random(seed)
        kind = rng.choice(self.kinds)
        kinds = (kind, "asf") if kind == "amc" else (kind,)
        content = {name: min(rng.choices(corpus(self.folders, name), k=2), key=len) for name in kinds}
        wrong = rng.choice(list(content))
        content[wrong] = mutate(rng, content[wrong], corpus(self.folders, wrong), text=kind != "c3d")
        for name, each in content.items():
            (place / f"take.{name}").write_bytes(each)
        return place / f"take.{kind}"


@contextmanager
def _hurry() -> Iterator[None]:
    """Raise HangError in the block after ``SECONDS`` of processor time."""

    def late(number: int, frame: object) -> None:
        raise HangError

    signal.signal(signal.SIGPROF, late)
    signal.setitimer(signal.ITIMER_PROF, SECONDS)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
