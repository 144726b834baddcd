"""The panel beside a view: verdict, margins and foot forces of the instant shown, the curve of the margin.

In a page that needs no server it follows the slider of viser's player, which it reads from the page. A click
on the curve shows that instant.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ocptip.basics.text import percent, quantity
from ocptip.basics.write import plain

GOOD, BAD, WARNING = "#1a7f37", "#c0281e", "#b35c00"
_WIDE, _HIGH = 250, 80  # pixels of the curve
_LEGEND = (
    "<div style='color:#555;margin-top:4px'><b style='color:rgb(30,140,60)'>green</b> contact forces, "
    "<b style='color:rgb(200,30,30)'>red</b> nearest tipping axis, "
    "<b style='color:rgb(220,0,160)'>magenta</b> zero-moment point"
)


@dataclass(frozen=True, eq=False)
class MarginPanel:
    """What the panel shows at T instants.

    Attributes:
        times: (T,), s.
        moments: (T,) tipping margin, N m; NaN where the base cannot tip.
        friction: (T,) share of the friction that is used.
        forces: (T, n) normal forces of the contacts, N.
        stable: (T,) no contact is lost.
        more: of the legend, HTML.
    """

    times: np.ndarray
    moments: np.ndarray
    friction: np.ndarray
    forces: np.ndarray
    stable: np.ndarray
    more: str = ""

    @property
    def moving(self) -> bool:
        """There is more than one instant."""
        return len(self.times) > 1

    @property
    def worst(self) -> int:
        """The instant with the minimum tipping margin, or with the maximum friction used."""
        values = self.moments if np.isfinite(self.moments).any() else -self.friction
        return int(np.nanargmin(values)) if np.isfinite(values).any() else 0

    def text(self, k: int) -> str:
        """Verdict, margins and foot forces at instant k, as HTML."""
        color, word = (GOOD, "STABLE") if self.stable[k] else (BAD, "A CONTACT IS LOST")
        forces = ", ".join(quantity(float(force), "N", 3) for force in self.forces[k])
        rows = [
            ("tipping margin", quantity(float(self.moments[k]), "N m", 3)),
            ("friction used", percent(float(self.friction[k])) if np.isfinite(self.friction[k]) else "-"),
            ("foot forces", forces),
        ]
        lines = "".join(f"<div>{name} <b>{value}</b></div>" for name, value in rows)
        time = f" {self.times[k]:.2f} s" if self.moving else ""
        return f"<b style='color:{color};font-size:15px'>{word}</b>{time}{lines}"

    def curve(self, k: int) -> str:
        """The tipping margin over time as SVG, with the worst instant and a cursor at instant k."""
        known = np.nan_to_num(self.moments)
        top, end = max(float(known.max()), 1e-9), max(float(self.times[-1]), 1e-9)
        x, y = _WIDE * self.times / end, _HIGH - 4 - (_HIGH - 8) * np.clip(known / top, 0.0, 1.0)
        points = " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(x, y, strict=True))
        worst = self.worst
        return (
            f"<svg class='ocptip-curve' width='{_WIDE}' height='{_HIGH}' style='background:#f7f7f7;"
            f"cursor:pointer;margin-top:4px'><polyline points='{points}' fill='none' stroke='#0072b2' "
            f"stroke-width='2'/><circle cx='{x[worst]:.1f}' cy='{y[worst]:.1f}' r='5' fill='none' "
            f"stroke='{BAD}' stroke-width='2'/><line class='ocptip-cursor' x1='{x[k]:.1f}' x2='{x[k]:.1f}' "
            f"y1='0' y2='{_HIGH}' stroke='black'/></svg>"
            f"<div style='color:#555'>tipping margin, 0 to {quantity(top, 'N m', 3)}; ring: minimum, "
            f"{self.times[worst]:.2f} s</div>"
        )

    def html(self, k: int) -> str:
        """The panel at instant k."""
        curve = self.curve(k) if self.moving else ""
        body = f"<div class='ocptip-text'>{self.text(k)}</div>{curve}{_LEGEND}{self.more}</div>"
        return f"<div style='font:13px sans-serif;margin:4px 12px'>{body}</div>"

    def overlaid(self, page: str) -> str:
        """A page of viser's player with the panel, which follows it."""
        panel = (
            "<div id='ocptip-panel' style='position:fixed;left:12px;top:12px;width:290px;z-index:1000;"
            "background:white;border:1px solid #ddd;padding:6px'>"
            f"{self.html(0)}{self._linked() if self.moving else ''}</div>"
        )
        end = page.rfind("</body>")
        return f"{page[:end]}{panel}{page[end:]}" if end >= 0 else page + panel

    def _linked(self) -> str:
        """The button, and the script that links text, curve and player."""
        data = {"times": self.times, "texts": [self.text(k) for k in range(len(self.times))]}
        known = json.dumps(plain({**data, "worst": self.worst, "wide": _WIDE}))
        script = Path(__file__).with_suffix(".js").read_text(encoding="utf-8").replace("DATA", known)
        button = "<button class='ocptip-worst' style='margin-top:4px'>show the minimum margin</button>"
        return f"<div style='margin:0 12px'>{button}</div><script>{script}</script>"
