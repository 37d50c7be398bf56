"""Pages in a real browser: headless Chromium, driven by chromedriver (apt-get install chromium chromium-driver)."""

import json
import re
import shutil
import subprocess
import time
import zlib
from base64 import b64decode
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from urllib.error import HTTPError
from urllib.request import Request, urlopen

import numpy as np
import pytest
from scenes import LIMIT

CHROMIUM = next(
    (
        path
        for name in ("chromium", "chromium-browser", "google-chrome")
        if (path := shutil.which(name))
    ),
    None,
)
in_browser = pytest.mark.skipif(
    not (CHROMIUM and shutil.which("chromedriver")),
    reason="no Chromium with chromedriver (apt-get install chromium chromium-driver)",
)

ARGUMENTS = (
    "headless=new",
    "no-sandbox",
    "disable-dev-shm-usage",
    "enable-unsafe-swiftshader",
    "use-angle=swiftshader",
)


class Page:
    """A page in a window; its commands are those of WebDriver (w3.org/TR/webdriver2)."""

    def __init__(self, driver: str, width: int, height: int, profile: Path) -> None:
        arguments = [*ARGUMENTS, f"window-size={width},{height}", f"user-data-dir={profile}"]
        wanted = {"goog:chromeOptions": {"binary": CHROMIUM, "args": arguments}}
        self._session = driver
        made = self._post("session", {"capabilities": {"alwaysMatch": wanted}})
        self._session = f"{driver}/session/{made['sessionId']}"

    def _post(self, command: str, content: dict) -> Any:
        request = Request(f"{self._session}/{command}", json.dumps(content).encode())
        try:
            with urlopen(request, timeout=LIMIT) as answer:
                return json.load(answer)["value"]
        except HTTPError as error:
            raise AssertionError(f"{command}: {error.read().decode()}") from None

    def close(self) -> None:
        urlopen(Request(self._session, method="DELETE"), timeout=LIMIT).close()

    def open(self, path: Path, mark: str = "") -> None:
        self._post("url", {"url": f"file://{path}{mark}"})

    def tell(self, expression: str) -> Any:
        """The value of an expression of JavaScript; of a script, what it returns."""
        script = expression if "return " in expression else f"return {expression}"
        return self._post("execute/sync", {"script": script, "args": []})

    def wait(self, expression: str) -> Any:
        """The value of an expression as soon as it is none of false, 0, "" and null."""
        end = time.monotonic() + LIMIT / 10
        while not (value := self.tell(expression)):
            assert time.monotonic() < end, f"{expression} stays {value!r}"
            time.sleep(0.1)
        return value

    def set(self, name: str, value: Any) -> None:
        """Move a control of the page, as a user does."""
        self.tell(
            f"const one = document.querySelector('[name={name}]'); one.value = {json.dumps(value)};"
            "one.dispatchEvent(new Event('input', {bubbles: true})); return 0"
        )

    def pointer(self, *path: tuple[float, float]) -> None:
        """Press the left button at the first place (pixels of the window), and let it go at the last."""
        way = [
            {"type": "pointerMove", "x": round(x), "y": round(y), "duration": 50} for x, y in path
        ]
        press = [{"type": f"pointer{what}", "button": 0} for what in ("Down", "Up")]
        actions = [way[0], press[0], *way[1:], press[1]]
        self._post("actions", {"actions": [{"type": "pointer", "id": "mouse", "actions": actions}]})


@contextmanager
def opened(path: Path, mark: str = "", width: int = 800, height: int = 600) -> Iterator[Page]:
    """A file as a page in a window of this size, in a browser of its own."""
    driver = subprocess.Popen(
        ["chromedriver", "--port=0"], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )
    try:
        port = next(
            found[1]
            for line in driver.stdout
            if (found := re.search(r"successfully on port (\d+)", line))
        )
        page = Page(f"http://127.0.0.1:{port}", width, height, path.parent / "profile")
        try:
            page.open(path, mark)
            yield page
        finally:
            page.close()
    finally:
        driver.terminate()
        driver.wait()


def unpacked(path: Path) -> tuple[dict, dict[str, np.ndarray]]:
    """The head of a view, and its arrays as the page reads them."""
    text = path.read_text(encoding="utf-8")
    head, data = (
        re.search(rf'id="{name}">(.*?)</script>', text, re.S)[1] for name in ("head", "data")
    )
    block, arrays = zlib.decompress(b64decode(data)), {}
    for name, of in json.loads(head)["arrays"].items():
        raw = np.frombuffer(block, f"<{of['type']}", of["size"], of["at"])
        arrays[name] = of["low"] + (of["high"] - of["low"]) * raw / 65535 if "high" in of else raw
    return json.loads(head), arrays
