"""Screenshot of the explorer: the hall with TurtleBot 4's lidar, both paths and an error ellipse.

Run: python examples/explorer_picture.py [FOLDER [MAP]]

Needs playwright and an installed Chromium, as well as the packages of the explorer.
"""

from __future__ import annotations

import shutil
import sys
from io import BytesIO
from pathlib import Path

from PIL import Image

import locplan

MAPS = Path(__file__).resolve().parent.parent / "maps"
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "chrome")
"""Commands that start a browser. The first installed one is used."""
FLAGS = ["--no-sandbox", "--disable-gpu", "--disable-background-networking"]
SIZE = {"width": 1400, "height": 900}
"""Size of the window [px]."""
POINTED = (400.0, 480.0)
"""Position of the cursor in the window [px], in the degenerate part of the hall."""
PATIENCE = 600_000
"""Timeout until both paths are shown [ms]. The first run computes the field."""


def find_browser() -> str | None:
    """Return the path of an installed browser, if there is one."""
    return next((path for name in BROWSERS if (path := shutil.which(name))), None)


def take_screenshot(address: str, browser: str) -> bytes:
    """Return the page at an address as a PNG, once both paths are shown."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=browser, args=FLAGS)
        page = chromium.new_page(viewport=SIZE, color_scheme="light", reduced_motion="reduce")
        page.set_default_timeout(PATIENCE)
        page.goto(address)
        page.locator('html[data-plan="fresh"][data-spots="fresh"]').wait_for(state="attached")
        page.mouse.move(*POINTED)
        page.locator(".readout", has_text="Position").wait_for()
        picture = page.screenshot()
        chromium.close()
    return picture


def main(folder: str = "explorer_picture", map_name: str = "hall") -> None:
    """Write explorer.png into a folder, with 256 colours."""
    browser = find_browser()
    if browser is None:
        sys.exit(f"explorer_picture needs a browser; install one of {', '.join(BROWSERS)}")
    grid = locplan.load_map(MAPS / f"{map_name}.yaml")
    with locplan.explore(grid, robot=locplan.Robot("turtlebot4"), open_browser=False) as explorer:
        picture = take_screenshot(explorer.address, browser)
    file = Path(folder) / "explorer.png"
    file.parent.mkdir(parents=True, exist_ok=True)
    page = Image.open(BytesIO(picture)).convert("RGB")
    colours = page.quantize(256, kmeans=3)
    colours.save(file, optimize=True)
    print(f"wrote {file}, {file.stat().st_size / 1000:.0f} kB")


if __name__ == "__main__":
    main(*sys.argv[1:3])
