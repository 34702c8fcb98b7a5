"""The page of a report in headless Chromium: it fits a phone, prints, and asks nothing of the network."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from browser.chromium import Page

from ortilo_drake.views.page.report_page import report_page

pytestmark = pytest.mark.long


@pytest.mark.parametrize("width", [390, 1280])
def test_a_report(tab: Page, tmp_path: Path, width: int) -> None:
    columns = " | ".join(f"column {i}" for i in range(20))  # wider than a phone
    text = f"# Analysis of own\n\n| {columns} |\n| {' | '.join(['---'] * 20)} |\n| {columns} |\n"
    (tmp_path / "own.md").write_text(text, encoding="utf-8")
    cv2.imwrite(str(tmp_path / "tube.png"), np.full((40, 1600, 3), 99, np.uint8))
    file = tmp_path / "report.html"
    file.write_text(report_page(tmp_path), encoding="utf-8")
    tab.errors.clear()
    tab.requests.clear()
    tab.open(file.as_uri(), width)
    assert tab.run("document.querySelector('img').naturalWidth") == 1600
    assert tab.run("document.documentElement.scrollWidth <= window.innerWidth")
    assert tab.pdf().startswith(b"%PDF-")
    assert all(url.startswith(("file:", "data:")) for url in tab.requests)
    assert tab.errors == []
