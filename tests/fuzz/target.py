"""One mutated input through read, detect, fill and write: our own errors, or an output that can be read."""

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

SECONDS = 5.0
LARGEST = 400_000
SETTINGS = Settings(method="linear", self_check=False, overwrite=True)


@lru_cache
def corpus(folders: tuple[Path, ...], kind: str) -> list[bytes]:
    """The files of a kind (c3d, bvh, amc, asf) in folders, but for large ones; long texts are cut after some lines."""
    paths = {path for folder in folders for path in folder.rglob("*") if path.suffix.lower() == f".{kind}"}
    found = [path.read_bytes() for path in sorted(paths)]
    if kind != "c3d":
        found = [b"".join(content.splitlines(keepends=True)[:600]) for content in found]
    return [content for content in found if len(content) <= LARGEST]


class HangError(Exception):
    """An input took more processor time than any may."""


@dataclass(frozen=True)
class Fuzz:
    """Try the input of a seed; the answer is what went wrong, or "refused" or "repaired"."""

    folders: tuple[Path, ...]
    found: Path

    def __call__(self, seed: int) -> str:
        """Mutate and repair; an input that breaks something is kept in the folder ``found``."""
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
        """Nothing: what a lost process leaves is in a temporary folder."""

    def input(self, seed: int, place: Path) -> Path:
        """The mutated file of a seed, in a folder, made from the smaller of two, so that more are tried in a time."""
        rng = random.Random(seed)
        kind = rng.choice(("c3d", "c3d", "bvh", "amc"))
        kinds = (kind, "asf") if kind == "amc" else (kind,)
        content = {name: min(rng.choices(corpus(self.folders, name), k=2), key=len) for name in kinds}
        wrong = rng.choice(list(content))
        content[wrong] = mutate(rng, content[wrong], corpus(self.folders, wrong), text=kind != "c3d")
        for name, each in content.items():
            (place / f"take.{name}").write_bytes(each)
        return place / f"take.{kind}"


@contextmanager
def _hurry() -> Iterator[None]:
    """Raise HangError after so much processor time."""

    def late(number: int, frame: object) -> None:
        raise HangError

    signal.signal(signal.SIGPROF, late)
    signal.setitimer(signal.ITIMER_PROF, SECONDS)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
