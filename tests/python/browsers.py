"""Chromium for tests that look at pages.

Set ELLIPTUDE_NEEDS_BROWSER (as .ci/run does) to fail instead of skip where there is no browser. Screenshots are left in
ELLIPTUDE_SCREENSHOTS, if that names a folder.
"""

import os
import shutil
from contextlib import contextmanager
from pathlib import Path

import pytest

NEEDED = bool(os.environ.get("ELLIPTUDE_NEEDS_BROWSER"))
# Drawn by the processor: machines that test have no graphics card. Root needs the second.
ARGUMENTS = ["--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--no-sandbox"]


@contextmanager
def chromium():
    """The browser, started; a test without one is skipped."""
    program = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
    if program is None:
        assert not NEEDED, "ELLIPTUDE_NEEDS_BROWSER is set, but there is no Chromium"
        pytest.skip("no Chromium: tools/install_system_packages.sh browser")
    if not NEEDED:
        pytest.importorskip("playwright.sync_api", reason="no playwright: pip install playwright")
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=program, args=ARGUMENTS)
        yield browser
        browser.close()


@contextmanager
def offline(browser, **settings):
    """A page without a network; at the end it must have said nothing wrong, and asked for nothing from elsewhere."""
    context = browser.new_context(offline=True, **settings)
    page = context.new_page()
    said, asked = [], []
    page.on("console", lambda message: said.append(message.text) if message.type == "error" else None)
    page.on("pageerror", lambda error: said.append(str(error)))
    page.on("request", lambda request: asked.append(request.url))
    yield page
    context.close()
    assert said == []
    assert [url for url in asked if not url.startswith(("file:", "data:", "blob:"))] == []


def screenshots(folder: Path) -> Path:
    """Where pictures of pages are left."""
    return Path(os.environ.get("ELLIPTUDE_SCREENSHOTS", folder))
