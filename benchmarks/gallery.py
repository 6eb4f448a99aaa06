"""Make the pictures of the documents from the sample takes and simulated ones: python benchmarks/gallery.py

It needs the extras html, plots and test, and Chromium. Each is a PNG of 128 colours in docs/images, to stay small.
"""

import os
import shutil
import subprocess
import sys
import tempfile
from io import BytesIO
from pathlib import Path

from PIL import Image
from playwright.sync_api import Page, sync_playwright

ROOT = Path(__file__).resolve().parents[1]
IMAGES = ROOT / "docs" / "images"
READY = "document.body.dataset.ready || document.body.dataset.show == 'overview'"
COLOURS = 128
SESSION = ((0.02, ""), (0.05, "spike"), (0.3, ""), (0.05, "swap,jump"))
"""Share of missing samples and kinds of faults of the takes in the overview."""
MOST_BYTES = 150_000
PLOTS = {
    "gaps": "plot walk.c3d -o gaps.png",
    "strn": "plot walk.c3d --marker STRN -o strn.png",
    "bones": "plot walk.c3d --bones -o bones.png",
    "head": "plot walk.bvh --marker Head -o head.png",
}
"""The pictures that a command draws, run in the folder of the sample takes."""
SCREENSHOTS = ("take", "curves", "overview", "dark")
"""The pictures of the page in a browser."""


def main() -> None:
    plots()
    screenshots()


def plots() -> None:
    with tempfile.TemporaryDirectory() as folder:
        shutil.copytree(ROOT / "sample_data", folder, dirs_exist_ok=True)
        for name, command in PLOTS.items():
            subprocess.run([sys.executable, "-m", "mocapclean", *command.split()], check=True, cwd=folder)
            store((Path(folder) / f"{name}.png").read_bytes(), name)


def screenshots() -> None:
    program = shutil.which("chromium") or shutil.which("google-chrome")
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as play:
        walk, takes = pages(Path(folder))
        arguments = ["--no-sandbox"] if hasattr(os, "geteuid") and os.geteuid() == 0 else []
        browser = play.chromium.launch(executable_path=program, args=arguments)
        light = browser.new_page(viewport={"width": 1280, "height": 860})
        opened(light, walk, "RSHN", 380)
        store(light.screenshot(), "take")
        store(light.locator(".columns").screenshot(), "curves")
        opened(light, takes)
        store(light.screenshot(clip={"x": 0, "y": 0, "width": 1280, "height": 480}), "overview")
        dark = browser.new_page(viewport={"width": 1280, "height": 860}, color_scheme="dark")
        opened(dark, walk, "C7", 90)
        dark.locator(".columns").evaluate("element => element.nextElementSibling.scrollIntoView()")
        dark.wait_for_timeout(500)
        store(dark.screenshot(), "dark")
        browser.close()


def pages(folder: Path) -> tuple[Path, Path]:
    """Return the page of the sample take, and that of this take and a few simulated sessions."""
    samples, walk, takes = ROOT / "sample_data", folder / "walk.html", folder / "takes.html"
    fill = [sys.executable, "-m", "mocapclean", "fill", "-q"]
    truth = ["--reference", samples / "walk_truth.c3d"]
    subprocess.run(
        [*fill, samples / "walk.c3d", "-o", folder / "walk.c3d", "--html", walk, *truth], check=True, cwd=ROOT
    )
    shutil.copytree(samples, folder / "takes" / "sample")
    for seed, (missing, faults) in enumerate(SESSION):
        simulate = [sys.executable, "-m", "mocapclean", "simulate", "--seconds", "4", "--seed", str(seed)]
        chosen = ["--missing", str(missing), *(["--faults", faults] if faults else [])]
        subprocess.run([*simulate, "--out-dir", f"takes/session{seed + 1}", *chosen], check=True, cwd=folder, stdout=-3)
    only = ["--include-files", "walk.c3d", "--include-files", "boxing.c3d"]
    subprocess.run([*fill, "takes", "--out-dir", "clean", "--html", takes.name, *only], check=True, cwd=folder)
    return walk, takes


def opened(page: Page, path: Path, marker: str = "", frame: int = 0) -> None:
    """Open a page, at a marker and a frame."""
    page.goto(path.as_uri())
    page.wait_for_function(READY)
    if marker:
        page.evaluate("([marker, frame]) => mocapclean.view().go(marker, frame)", [marker, frame])
        page.wait_for_timeout(800)
        page.evaluate("scrollTo(0, 0)")
    page.wait_for_timeout(500)


def store(png: bytes, name: str) -> None:
    """Write a picture with few colours."""
    IMAGES.mkdir(exist_ok=True)
    path = IMAGES / f"{name}.png"
    Image.open(BytesIO(png)).convert("RGB").quantize(COLOURS).save(path, optimize=True)
    size = path.stat().st_size
    print(f"{path.relative_to(ROOT)}: {size:,} bytes")
    assert size < MOST_BYTES


if __name__ == "__main__":
    main()
