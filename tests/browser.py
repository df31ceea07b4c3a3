"""Look at pages in Chromium: nothing is loaded, nothing fails, it prints, and a screen reader finds its way.

python -m tests.browser [PAGE.html]... [--chromium PATH] [--out FOLDER]

Without a page, the samples of docs/samples/. Needs the extra ``browser`` and a Chromium; opens no connection.
Ends with 1 if anything was found. --out keeps pictures (wide, narrow, dark) and the printed page, to be
looked at: whether a page reads well is for eyes.
"""

from __future__ import annotations

import argparse
import io
import re
import shutil
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Browser, Page, sync_playwright
from pypdf import PdfReader

from verifier.reports.text import DISCLAIMER

ROOT = Path(__file__).parent.parent
WIDE, NARROW = (1280, 900), (390, 844)
A4_POINTS = (595.3, 841.9)
SETTLE_MS = 300
KEPT_CONTROLS = "button, summary, a[href^='#'], input, select"


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("pages", nargs="*", type=Path)
    parser.add_argument("--chromium", default=shutil.which("chromium"))
    parser.add_argument("--out", type=Path)
    given = parser.parse_args(arguments)
    if given.chromium is None:
        parser.error("no chromium on the path: name one with --chromium")
    pages = given.pages or sorted((ROOT / "docs" / "samples").glob("*.html"))
    found = 0
    with sync_playwright() as driver:
        # a page of one's own, and root has no sandbox in a container
        browser = driver.chromium.launch(executable_path=given.chromium, args=["--no-sandbox"])
        print(f"Chromium {browser.version}")
        for path in pages:
            faults = list(faults_of(browser, path.resolve(), given.out))
            print(f"{path.name}: {'nothing found' if not faults else f'{len(faults)} found'}")
            for fault in faults:
                print(f"  {fault}")
            found += len(faults)
        browser.close()
    return 1 if found else 0


def faults_of(browser: Browser, path: Path, out: Path | None = None) -> Iterator[str]:
    """Say what is wrong with a page, one line each."""
    for size, scheme in ((WIDE, "light"), (NARROW, "light"), (WIDE, "dark")):
        where = f"{size[0]} px, {scheme}"
        with _opened(browser, path, size, scheme) as (page, heard):
            yield from (f"{where}: {each}" for each in _too_wide(page))
            if size == WIDE:
                yield from (f"{where}: {each}" for each in _unreadable(page))
            if out is not None:
                out.mkdir(parents=True, exist_ok=True)
                page.screenshot(path=out / f"{path.stem}-{size[0]}-{scheme}.png", full_page=True)
            _use(page)
            yield from (f"{where}: {each}" for each in heard)
    with _opened(browser, path, WIDE, "light") as (page, heard):
        printed = page.pdf(prefer_css_page_size=True, print_background=True)
        yield from (f"print: {each}" for each in [*heard, *_printed(printed)])
        if out is not None:
            (out / f"{path.stem}.pdf").write_bytes(printed)


@contextmanager
def _opened(
    browser: Browser, path: Path, size: tuple[int, int], scheme: Any
) -> Iterator[tuple[Page, list[str]]]:
    """A page that has been read, and what is heard from it: requests but for its own, errors, warnings."""
    context = browser.new_context(
        viewport={"width": size[0], "height": size[1]}, color_scheme=scheme, offline=True
    )
    page, heard = context.new_page(), list[str]()
    own = path.as_uri()

    def requested(request: Any) -> None:
        if request.url.split("#")[0] != own and not request.url.startswith("data:"):
            heard.append(f"asks for {request.url}")

    page.on("request", requested)
    page.on("console", lambda message: heard.append(f"console, {message.type}: {message.text}"))
    page.on("pageerror", lambda error: heard.append(f"error: {error}"))
    page.goto(own, wait_until="load")
    page.wait_for_timeout(SETTLE_MS)
    try:
        yield page, heard
    finally:
        context.close()


def _too_wide(page: Page) -> Iterator[str]:
    """A page that has to be moved sideways to be read; a table within it may."""
    whole, seen = page.evaluate(
        "[document.documentElement.scrollWidth, document.documentElement.clientWidth]"
    )
    if whole > seen:
        yield f"{whole} px wide, {seen} px can be seen"


def _unreadable(page: Page) -> Iterator[str]:
    """What axe finds against WCAG: names, order of headings, contrast, tables, landmarks.

    The watermark is faint on purpose, and hidden from screen readers: the text says the same in words.
    """
    for each in Axe().run(page, context={"exclude": [[".watermark"]]}).response["violations"]:
        times, first = len(each["nodes"]), each["nodes"][0]["html"][:120]
        yield f"axe {each['id']} ({each['impact']}): {each['help']}; {times} times, {first}"


def _use(page: Page) -> None:
    """Go through everything that a keyboard reaches, and press it; move over every chart."""
    for control in page.locator(KEPT_CONTROLS).all():
        if control.is_visible():
            control.focus()
            page.keyboard.press("Enter")
            page.keyboard.press("ArrowRight")
    for chart in page.locator("svg").all():
        if chart.is_visible():
            chart.hover(force=True)
            page.mouse.wheel(0, -120)
    page.wait_for_timeout(SETTLE_MS)


def _printed(pdf: bytes) -> Iterator[str]:
    """Every printed page is A4 and carries the footer."""
    wanted = re.sub(r"\W+", "", DISCLAIMER)
    for k, sheet in enumerate(PdfReader(io.BytesIO(pdf)).pages, start=1):
        size = (float(sheet.mediabox.width), float(sheet.mediabox.height))
        if any(abs(have - want) > 2.0 for have, want in zip(size, A4_POINTS, strict=True)):
            yield f"page {k} is {size[0]:.0f} × {size[1]:.0f} points, not A4"
        if wanted not in re.sub(r"\W+", "", sheet.extract_text()):
            yield f"page {k} has no footer"


if __name__ == "__main__":
    sys.exit(main())
