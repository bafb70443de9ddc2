"""A real browser for the tests of pages: headless Chromium, where the machine has one."""

import shutil
from contextlib import contextmanager

import pytest

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
ARGUMENTS = (
    "--headless --no-sandbox --disable-gpu --disable-quic --no-first-run --disable-background-networking "
    "--disable-component-update --disable-sync"
)
needs_browser = pytest.mark.skipif(
    CHROMIUM is None, reason="no Chromium on this machine; Debian: apt-get install chromium"
)


def expect(locator):
    """Wait for what is said of a part of a page; see Playwright's assertions."""
    from playwright import sync_api  # imported here: only a browser needs it, and every run finds the tests

    return sync_api.expect(locator)


@contextmanager
def browser(profile):
    """Run Chromium with its profile in the folder `profile`; gives the context that opens pages."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        context = playwright.chromium.launch_persistent_context(
            profile, executable_path=CHROMIUM, args=ARGUMENTS.split(" ")
        )
        yield context
        context.close()
