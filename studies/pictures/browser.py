"""A headless Chromium that opens pages, presses keys and takes pictures, over its own DevTools protocol."""

from __future__ import annotations

import base64
import json
import shutil
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from urllib.request import urlopen

from websockets.sync.client import connect  # comes with viser

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
_OPTIONS = (
    *("--headless", "--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"),
    *("--remote-debugging-port=0", "--disable-background-networking", "--no-first-run"),
    "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1, EXCLUDE localhost",
)
_PATIENCE = 60.0  # s


class Page:
    """One page of the browser.

    Args:
        socket: of the page's debugger.

    Attributes:
        errors: messages of the console that are errors, and exceptions.
    """

    def __init__(self, socket: Any) -> None:
        self._socket, self._number, self.errors = socket, 0, list[str]()
        for domain in ("Page", "Runtime"):
            self.call(f"{domain}.enable")

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Result of a method of the protocol."""
        self._number += 1
        self._socket.send(json.dumps({"id": self._number, "method": method, "params": parameters}))
        while True:
            message = json.loads(self._socket.recv(timeout=_PATIENCE))
            if message.get("method") == "Runtime.exceptionThrown":
                self.errors.append(json.dumps(message["params"])[:500])
            if message.get("id") == self._number:
                assert "error" not in message, message
                return message["result"]

    def run(self, script: str) -> Any:
        """Value of a JavaScript expression."""
        return self.call("Runtime.evaluate", expression=script, returnByValue=True)["result"].get("value")

    def text(self) -> str:
        """What can be read on the page."""
        return str(self.run("document.body ? document.body.innerText : ''"))

    def wait_for(self, script: str) -> Any:
        """The value of an expression as soon as it is true."""
        end = time.monotonic() + _PATIENCE
        while not (value := self.run(script)):
            assert time.monotonic() < end, f"never true: {script}; the page says {self.text()[:2000]}"
            time.sleep(0.05)
        return value

    def enter(self, label: str, value: float) -> None:
        """Type a number into the field of a slider, as a person does."""
        self.wait_for(f"({_FIELD})({json.dumps(label)})")
        self.call("Input.insertText", text=f"{value:g}")
        for kind in ("keyDown", "keyUp"):
            self.call(
                "Input.dispatchKeyEvent", type=kind, key="Enter", code="Enter", windowsVirtualKeyCode=13
            )

    def drag(self, label: str, share: float) -> None:
        """Drag a slider to a share of its length with the mouse."""
        x, y, to = self.wait_for(f"({_SLIDER})({json.dumps(label)}, {share})")
        for kind, place in (("Pressed", x), ("Moved", (x + to) / 2), ("Moved", to), ("Released", to)):
            pressed = {"button": "left", "buttons": 1, "clickCount": 1}
            self.call("Input.dispatchMouseEvent", type=f"mouse{kind}", x=place, y=y, **pressed)

    def picture(self, path: Path) -> None:
        """Write what is seen into a PNG file."""
        path.write_bytes(base64.b64decode(self.call("Page.captureScreenshot")["data"]))


_SLIDER = """(label, share) => {
  const rows = [...document.querySelectorAll('label, span, div, p')]
    .filter(one => one.childElementCount === 0 && one.textContent.trim() === label);
  for (let row of rows)
    for (let up = row; up && up !== document.body; up = up.parentElement) {
      const thumb = up.querySelector('[role=slider]');
      if (thumb) {
        thumb.scrollIntoView({block: 'center', behavior: 'instant'});
        const at = thumb.getBoundingClientRect();
        const track = thumb.parentElement.getBoundingClientRect();
        return [at.x + at.width / 2, at.y + at.height / 2, track.x + share * track.width];
      }
    }
  return null;
}"""
"""Where the thumb of the slider beside a label is, and where it would be at a share of the length."""

_FIELD = """label => {
  const found = [...document.querySelectorAll('label, span, div, p')]
    .filter(one => one.childElementCount === 0 && one.textContent.trim() === label);
  for (let row of found)
    for (let up = row; up && up !== document.body; up = up.parentElement) {
      const field = [...up.querySelectorAll('input')].find(one => one.offsetWidth > 0);
      if (field) {
        field.scrollIntoView({block: 'center', behavior: 'instant'});
        field.focus();
        field.select();
        return true;
      }
    }
  return false;
}"""
"""Selects what is in the first field beside a label; whether there is one."""


@contextmanager
def browser_page(address: str, *, width: int = 1400, height: int = 900) -> Iterator[Page]:
    """The page at an address, while it is open."""
    assert CHROMIUM is not None, "no chromium: apt-get install chromium"
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:  # it still writes while it ends
        options = [*_OPTIONS, f"--user-data-dir={folder}", f"--window-size={width},{height}"]
        process = subprocess.Popen([CHROMIUM, *options, address], stderr=subprocess.DEVNULL)
        try:
            port = _port(Path(folder))
            with urlopen(f"http://127.0.0.1:{port}/json") as answer:
                pages = [one for one in json.load(answer) if one["type"] == "page"]
            with connect(pages[0]["webSocketDebuggerUrl"], max_size=None) as socket:
                yield Page(socket)
        finally:
            process.terminate()
            process.wait()


def _port(folder: Path) -> int:
    """The port of the debugger, which the browser writes into its folder."""
    end = time.monotonic() + _PATIENCE
    while time.monotonic() < end:
        text = (folder / "DevToolsActivePort").read_text() if (folder / "DevToolsActivePort").exists() else ""
        if text.strip():
            return int(text.split()[0])
        time.sleep(0.05)
    raise AssertionError("chromium did not start")
