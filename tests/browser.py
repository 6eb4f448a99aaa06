"""A real browser for tests of the page: the system's Chromium, without a network."""

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
FINAL = "document.body.dataset.ready || document.body.dataset.show == 'overview'"


@contextmanager
def browsing() -> Iterator[object]:
    """Yield a browser; skip where there is none."""
    driver = pytest.importorskip("playwright.sync_api", reason="playwright is not installed (extra test)")
    program = next(filter(None, map(shutil.which, NAMES)), None)
    if program is None:
        pytest.skip("no Chromium is installed")
    arguments = ["--no-sandbox"] if hasattr(os, "geteuid") and os.geteuid() == 0 else []
    with driver.sync_playwright() as play:
        browser = play.chromium.launch(executable_path=program, args=arguments)
        yield browser
        browser.close()


class Visit:
    """A page opened from a file: what it prints as errors, and what it asks of a network."""

    def __init__(self, browser, path: Path, hash_: str = "", **options) -> None:
        self.context = browser.new_context(viewport={"width": 1300, "height": 1000}, **options)
        self.page = self.context.new_page()
        self.errors: list[str] = []
        self.requests: list[str] = []
        self.page.on("console", lambda message: message.type == "error" and self.errors.append(message.text))
        self.page.on("pageerror", lambda error: self.errors.append(str(error)))
        self.page.on("request", lambda request: self.requests.append(request.url))
        self.page.goto(path.absolute().as_uri() + hash_)
        self.page.wait_for_function(FINAL)

    def ready(self, take: int) -> None:
        """Wait until a take, by its index in the page, is drawn."""
        self.page.wait_for_function(
            "index => document.body.dataset.ready == mocapclean.page.takes[index].key", arg=take
        )

    def text(self, selector: str) -> str:
        return self.page.inner_text(selector)

    def __enter__(self) -> "Visit":
        return self

    def __exit__(self, *_) -> None:
        self.context.close()
