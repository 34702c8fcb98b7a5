"""One browser for the tests of pages; they are skipped where there is none."""

from collections.abc import Iterator

import pytest
from browser.chromium import Page, browser, chromium


@pytest.fixture(scope="session")
def tab(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    if chromium() is None:
        pytest.skip("chromium is missing (Debian: chromium): pages cannot be looked at")
    with browser(tmp_path_factory.mktemp("chromium")) as page:
        yield page
