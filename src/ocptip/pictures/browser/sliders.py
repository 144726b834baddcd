"""A page of sliders beside a picture: callbacks only note a change, one thread answers the latest state.

A drag over many values never queues: the later steps of an answer wait until nothing changes.
"""

from __future__ import annotations

import threading
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from html import escape
from typing import Any

import numpy as np

from ocptip.basics.errors import OcptipError
from ocptip.pictures.browser.panel import BAD, GOOD, WARNING
from ocptip.pictures.browser.view import GHOST, RATE, Act, mover
from ocptip.standing.parts import Part

FRESH, STALE = "opacity:1", "opacity:0.4"
_CELL = "style='padding:0 8px 0 0;line-height:1.35;vertical-align:top;white-space:"
_LONG = 28  # characters, from which on a value has several lines


@dataclass(frozen=True)
class Actions:
    """What buttons do.

    Attributes:
        keep: makes a posture "start" or "goal" of the task, and says where it was saved.
        plan: plans between the poses; a headline, and the motions.
    """

    keep: Callable[[str, np.ndarray], str]
    plan: Callable[[], tuple[str, Sequence[Part]]]


class SliderPage(ABC):
    """Scene and sliders on a viser server, with the thread that answers.

    Args:
        server: of viser.
        name: title of the page.
        units: of the n coordinates, "rad" or "m".
        ends: postures (n,) of "start" and "goal"; changed by the buttons.
        actions: of the buttons; None: nothing is kept or planned.
        size: m, of the picture.

    Attributes:
        sliders: handles by name; "q0" and so on are the coordinates, degrees or m.
        verdict, message: texts as HTML: the answer, and what is wrong.
        idle: set while nothing is left to answer.
    """

    def __init__(
        self,
        server: Any,
        name: str,
        units: Sequence[str],
        ends: dict[str, np.ndarray],
        actions: Actions | None,
        size: float,
    ) -> None:
        self.server, self.ends, self.actions, self.size = server, ends, actions, size
        self.sliders: dict[str, Any] = {}
        self.message: Any
        self.idle, self._changed, self._closed = threading.Event(), threading.Event(), threading.Event()
        self._aimed, self._lock = False, threading.Lock()
        self._turning = np.array(units) == "rad"
        self._count = 1
        self._plans: list[tuple[str, Sequence[Part]]] = []
        self._thread = threading.Thread(target=self._work, daemon=True)
        server.gui.configure_theme(show_logo=False, show_share_button=False, control_width="large")
        self.verdict = server.gui.add_html(f"<h3>{escape(name)}</h3>")

    @property
    @abstractmethod
    def steps(self) -> Sequence[Callable[[], None]]:
        """What answers the sliders, the quickest first."""

    @abstractmethod
    def show(self, act: Act, k: int) -> None:
        """Show frame k of a plan."""

    def begin(self) -> None:
        """Answer from now on."""
        self._changed.set()
        self._thread.start()

    def close(self) -> None:
        """End the thread."""
        self._closed.set()
        self._changed.set()
        self._thread.join()

    # --- sliders ------------------------------------------------------------------------------------------

    def slider(
        self, key: str, label: str, low: float, high: float, step: float, value: float, *, aims: bool = False
    ) -> None:
        """Add a slider; one that aims asks for a posture."""
        low, high = min(low, value), max(high, value)
        handle = self.server.gui.add_slider(label, low, high, step, float(value))
        handle.on_update(lambda _: self.note(aims))
        self.sliders[key] = handle

    def coordinate_sliders(
        self, names: Sequence[str], lower: np.ndarray, upper: np.ndarray, q: np.ndarray
    ) -> None:
        """Add a slider for each of n coordinates, rad or m, from its lower to its upper end."""
        for k, (name, turns) in enumerate(zip(names, self._turning, strict=True)):
            scale, unit, step = (180 / np.pi, "deg", 0.1) if turns else (1.0, "m", 1e-3)
            self.slider(f"q{k}", f"{name} [{unit}]", scale * lower[k], scale * upper[k], step, scale * q[k])

    def note(self, aims: bool = False) -> None:
        """A value changed; what the answers set asks nothing."""
        if threading.current_thread() is not self._thread:
            self._aimed |= aims
            with self._lock:
                self.idle.clear()
                self._changed.set()

    def set(self, key: str, value: float) -> None:
        """Move a slider."""
        handle = self.sliders[key]
        handle.value = float(np.clip(value, handle.min, handle.max))

    def posture(self) -> np.ndarray:
        """Coordinates (n,) of the sliders, rad and m."""
        values = np.array([self.sliders[f"q{k}"].value for k in range(len(self._turning))], dtype=float)
        return np.where(self._turning, np.radians(values), values)

    def set_posture(self, q: np.ndarray) -> None:
        """Move the sliders to a posture (n,), rad and m."""
        for k, value in enumerate(np.where(self._turning, np.degrees(q), q)):
            self.set(f"q{k}", float(value))

    # --- answers ------------------------------------------------------------------------------------------

    def _work(self) -> None:
        """Answer the latest state; what comes later is dropped where the state changed meanwhile."""
        while not self._closed.is_set():
            self._changed.wait()
            self._changed.clear()
            for step in self.steps:
                if not self._changed.is_set() and not self._closed.is_set():
                    self.guarded(step)
            with self._lock:
                if not self._changed.is_set():
                    self.idle.set()

    def guarded(self, step: Callable[[], None]) -> None:
        """Do something; errors are shown."""
        try:
            step()
        except OcptipError as error:
            self.tell(str(error), BAD)

    def tell(self, text: str, color: str) -> None:
        """Show what is wrong, or what a button did."""
        self.message.content = f"<p style='color:{color};margin:4px 12px'>{escape(text)}</p>" if text else ""

    # --- poses and plan -----------------------------------------------------------------------------------

    def pose_buttons(self) -> None:
        """Add the buttons that keep poses and plan between them."""
        gui = self.server.gui
        with gui.add_folder("Poses and plan"):
            save, go = (
                gui.add_button_group("save as", ("start", "goal")),
                gui.add_button_group("go to", ("start", "goal")),
            )
            save.on_click(lambda _: self._keep(save.value))
            go.on_click(lambda _: self.set_posture(self.ends[go.value]))
            gui.add_button("Plan and check").on_click(lambda _: self.plan())
            self._play_button = gui.add_button("Play", disabled=True)
            self._play_button.on_click(lambda _: self.play())

    def _keep(self, which: str) -> None:
        assert self.actions is not None
        q, keep = self.posture(), self.actions.keep
        self.ends[which] = q
        self._reported(lambda: keep(which, q))

    def plan(self) -> None:
        """Plan between the poses."""
        assert self.actions is not None
        find = self.actions.plan
        self.tell("planning ...", WARNING)

        def planned() -> str:
            headline, parts = find()
            self._plans = [*self._plans[-1:], (f"plan {self._count}", parts)]
            self._count += 1
            self._play_button.disabled = False
            return headline

        self._reported(planned)

    def _reported(self, action: Callable[[], str]) -> None:
        try:
            self.tell(action(), GOOD)
        except (OcptipError, OSError) as error:
            self.tell(str(error), BAD)

    def play(self) -> None:
        """Show the last plan with its forces, the one before as a ghost; then the posture of the sliders."""
        end = max(parts[-1].end for _, parts in self._plans)
        times = np.append(np.arange(0.0, end, 1 / RATE), end)
        *before, act = (Act.of_plan(name, parts, times) for name, parts in self._plans)
        scene = self.server.scene
        ghosts = [mover(scene, "/plan before", one, self.size, GHOST) for one in before]
        wait = threading.Event()
        for k in range(len(times)):
            self.show(act, k)
            for ghost in ghosts:
                ghost(k)
            texts = [act.clock(k), *(f"(ghost) {one.clock(k)}" for one in before)]
            self.verdict.content = f"<h3 style='margin:4px 12px'>{times[k]:.2f} s</h3>" + "".join(
                f"<p style='margin:4px 12px'>{escape(text)}</p>" for text in texts
            )
            wait.wait(1 / RATE)
        for _ in ghosts:
            scene.remove_by_name("/plan before")
        self.note()


def headed(title: str, color: str, rows: Sequence[tuple[str, str]]) -> str:
    """A heading above a table of names and values, as HTML."""
    return f"<h3 style='color:{color};margin:4px 12px'>{escape(title)}</h3>{table(rows)}"


def table(rows: Sequence[tuple[str, str]]) -> str:
    """Names and values as HTML."""
    cells = (
        f"<tr><td {_CELL}nowrap'>{escape(name)}</td>"
        f"<td {_CELL}{'normal' if len(value) > _LONG else 'nowrap'}'><b>{escape(value)}</b></td></tr>"
        for name, value in rows
    )
    return f"<table style='margin:0 12px;font-size:13px'>{''.join(cells)}</table>"


def section(title: str, rows: Sequence[tuple[str, str]], below: str = "", *, bad: bool = False) -> str:
    """A smaller table with a title and a note below, as HTML."""
    color, kind = BAD if bad else "#555", "margin:6px 14px 0;font-size"
    head = f"<p style='{kind}:13px;color:{color}'>{escape(title)}</p>"
    note = f"<p style='{kind}:11px;color:#555'>{escape(below)}</p>"
    return f"<div style='{FRESH}'>{head}{table(rows)}{note}</div>"
