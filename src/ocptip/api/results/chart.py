"""Load, tilt and push charts: cells, reaches, designs, and their files."""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ocptip.basics.outputs import SavedFolder
from ocptip.basics.text import percent, quantity
from ocptip.basics.write import versions
from ocptip.pictures.frame import png
from ocptip.pictures.load_chart import chart_figure, design_picture
from ocptip.reserves.equal_compliance import equally_compliant
from ocptip.standing.arm import Robot
from ocptip.standing.at_rest.chart_cells import ChartCell, ReachBySector
from ocptip.standing.at_rest.levels import LargestLevels
from ocptip.standing.at_rest.raised import Raised
from ocptip.standing.limits import SLIP_WITHIN, TIP_WITHIN, TORQUE_WITHIN, Limits
from ocptip.standing.within.design import DesignLevels
from ocptip.standing.within.tolerable import AT_REST

NOT_COVERED = ("motion", "process forces that vary", "postures that were not sampled")
_STEPS = (0.05, 0.1, 0.2, 0.25, 0.5, 1.0, 2.0, 5.0)  # m
_CELLS = 8  # cells of reach or height, at most


@dataclass(frozen=True, eq=False, repr=False)
class LoadChart(SavedFolder):
    """Load, tilt or push charts of a robot.

    Attributes:
        name: of the task.
        robot: on its base, as it rests.
        raised: what is charted.
        limits: that are kept, with the uncertainty.
        q: (N, n), rad (prismatic joints: m): the postures that do not collide.
        largest: their largest levels, SI units, and what limits them.
        drawn: number of postures that were drawn, and the seed.
        sectors: of the azimuth.
        cell: m, size of the cells of reach and height; None: at most 8 of each.
        levels: kg, deg or N, of the reaches by azimuth.
        most: kg, deg or N, the largest level that was tried.
        shares: of the limits of speed and acceleration of the joints, by option; height of a push, m.
        designs: levels on changed bases and at other speeds; empty if not asked for.
    """

    data_file = "chart.json"
    name: str
    robot: Robot
    raised: Raised
    limits: Limits
    q: np.ndarray
    largest: LargestLevels
    drawn: tuple[int, int]
    sectors: int
    cell: float | None
    levels: np.ndarray
    most: float
    shares: dict[str, float]
    designs: tuple[DesignLevels, ...] = ()

    @cached_property
    def places(self) -> np.ndarray:
        """(N, 3): azimuth, rad, from the base's x axis to y; reach, m, the horizontal distance of the TCP
        from the centre of the contacts; height, m, above the lowest contact.
        """
        feet = self._feet
        tool = self.robot.tool(self.q) - [*feet[:, :2].mean(axis=0), feet[:, 2].min()]
        half = np.pi / self.sectors  # sectors are about their middle, so that straight ahead is one of them
        azimuth = (np.arctan2(tool[:, 1], tool[:, 0]) + half) % (2 * np.pi) - half
        return np.column_stack([azimuth, np.hypot(tool[:, 0], tool[:, 1]), tool[:, 2]])

    @cached_property
    def edges(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Of the cells: azimuth, rad, reach and height, m."""
        reach, height = self.places[:, 1:].T
        lowest = float(height.min()) if len(self.q) else 0.0
        around = 2 * np.pi / self.sectors * (np.arange(self.sectors + 1) - 0.5)
        return around, _edges(0.0, reach, self.cell), _edges(lowest, height, self.cell)

    @cached_property
    def values(self) -> np.ndarray:
        """(N,) kg, deg or N: the largest levels of the postures."""
        return self.raised.scale * self.largest.levels

    @cached_property
    def _index(self) -> np.ndarray:
        """(N, 3) cell of each posture by azimuth, reach and height."""
        results = [
            np.clip(np.searchsorted(edges, values, side="right") - 1, 0, len(edges) - 2)
            for edges, values in zip(self.edges, self.places.T, strict=True)
        ]
        return np.column_stack(results).reshape(-1, 3)

    def cells(self, *, azimuth: bool = True, height: bool = True) -> list[ChartCell]:
        """The cells with postures, by azimuth, reach and height; without azimuth all around is one cell."""
        use = [azimuth, True, height]
        groups: dict[tuple[int, ...], list[int]] = {}
        for row, index in enumerate((self._index * use).tolist()):
            groups.setdefault(tuple(index), []).append(row)
        return [self._cell(index, np.array(rows), use) for index, rows in sorted(groups.items())]

    def _cell(self, index: tuple[int, ...], rows: np.ndarray, use: list[bool]) -> ChartCell:
        ends = [
            (float(edges[k]), float(edges[k + 1])) if used else None
            for edges, k, used in zip(self.edges, index, use, strict=True)
        ]
        values = self.values[rows]
        least, best = rows[np.argmin(values)], rows[np.argmax(values)]
        assert ends[1] is not None  # reach is always used
        return ChartCell(
            ends[0],
            ends[1],
            ends[2],
            len(rows),
            float(self.values[least]),
            float(self.values[best]),
            self._limit(least),
            self._limit(best),
        )

    def _limit(self, row: int) -> str:
        broken = "" if self.largest.kept_at_zero[row] else f" without {self.raised.name}"
        return self.largest.names[self.largest.limits[row]] + broken

    def within(self, largest: LargestLevels) -> tuple[float | None, ...]:
        """kg, deg or N that all postures up to each reach keep."""
        index = self._index[:, 1]
        values = self.raised.scale * np.where(largest.kept_at_zero, largest.levels, 0.0)
        within = [values[index <= k] for k in range(len(self.edges[1]) - 1)]
        return tuple(float(column.min()) if len(column) else None for column in within)

    @cached_property
    def reaches(self) -> tuple[ReachBySector, ...]:
        """Largest reach by azimuth of each of the levels."""
        results, sector, reach = [], self._index[:, 0], self.places[:, 1]
        for level in self.levels:
            holds = self.largest.kept_at_zero & (self.values >= level)
            ends: list[tuple[float | None, float | None]] = []
            for k in range(len(self.edges[0]) - 1):
                here = sector == k
                good, bad = reach[here & holds], reach[here & ~holds]
                sure = good[good < np.min(bad, initial=np.inf)]
                ends.append(
                    (float(np.max(sure, initial=0.0)), float(np.max(good)) if len(good) else None)
                    if here.any()
                    else (None, None)
                )
            results.append(ReachBySector(float(level), *(tuple(one) for one in zip(*ends, strict=True))))
        return tuple(results)

    @property
    def _feet(self) -> np.ndarray:
        """(n, 3), m, base frame: the contacts."""
        return np.array([contact.position for contact in self.robot.support.contacts])

    @property
    def summary(self) -> str:
        """The level of all postures, and of those up to half of the reach."""
        if not len(self.q):
            return "no posture drawn keeps the clearance"
        values, half = self.within(self.largest), (len(self.edges[1]) - 2) // 2
        known = [(k, value) for k, value in enumerate(values) if value is not None]
        near = next(((k, value) for k, value in known if k >= half), known[-1])
        unit = self.raised.unit
        ends = [f"{self.edges[1][k + 1]:.3g} m: {quantity(value, unit, 3)}" for k, value in (near, known[-1])]
        return f"{self.raised.name} of all postures up to a reach of {', '.join(dict.fromkeys(ends))}"

    @property
    def broken(self) -> int:
        """Number of postures that break a limit at level zero."""
        return int(np.sum(~self.largest.kept_at_zero))

    @property
    def scope(self) -> str:
        """What the chart is about, in words: motion, uncertainty, samples, seed."""
        tolerance = self.limits.tolerance
        within = f"within {tolerance.scope}" if tolerance.given else "nominal model only"
        within += f", in place of {self.raised.replaces}" if self.raised.replaces else ""
        return f"{self.motion}, {within}, {len(self.q)} of {self.drawn[0]} postures, seed {self.drawn[1]}"

    @property
    def moves(self) -> bool:
        """Whether joints move."""
        return bool(self.shares["joint_speed"] + self.shares["joint_acceleration"])

    @property
    def motion(self) -> str:
        """Of the joints, in words."""
        if not self.moves:
            return "at rest"
        shares = [
            f"{percent(self.shares[f'joint_{name}'])} of their {name}"
            for name in ("speed", "acceleration")
            if self.shares[f"joint_{name}"]
        ]
        return f"joints at up to {' and '.join(shares)} limits in any direction"

    @property
    def equally_compliant(self) -> bool:
        """Whether friction is that of equally compliant contacts: where contacts differ in it."""
        return equally_compliant(self.robot.support) is not None

    @property
    def not_covered(self) -> tuple[str, ...]:
        """What the chart leaves out."""
        return NOT_COVERED[self.moves :]

    @property
    def ignored(self) -> tuple[str, ...]:
        """Deviations of the uncertainty that need motion."""
        tolerance = self.limits.tolerance
        counted = (*AT_REST, *(("speed", "delay") if self.moves else ()))
        return tuple(str(tolerance.only(name)) for name in tolerance.given if name not in counted)

    def __repr__(self) -> str:
        """The scope, and the smallest and largest level."""
        values, unit = self.values, self.raised.unit
        ends = f"{values.min():.3g} to {values.max():.3g} {unit}" if len(values) else "no posture"
        return f"<LoadChart {self.name}: {self.raised.name} {ends}; {self.scope}>"

    def to_dict(self) -> dict[str, Any]:
        """The content of chart.json; see docs/how-to/load-charts.md."""
        limits, payload = self.limits, self.robot.payload
        names = ("GN", "GT", "torque_ratio", "clearance")
        within = TIP_WITHIN, SLIP_WITHIN, TORQUE_WITHIN
        given = limits.tolerance.given
        feet, (key, unit) = self._feet, self._key
        return {
            "task": self.name,
            "chart": self.raised.title,
            "scope": self.scope,
            "not_covered": [*self.not_covered, *self.ignored],
            "assumed": list(self.robot.notes),
            "equally_compliant": self.equally_compliant,
            "joints": self.shares,
            "tolerance": limits.tolerance.to_dict(),
            "limits": {name: getattr(limits, name) for name in (*names, *(within if given else ()))},
            "payload": {
                "rated_kg": payload.mass if payload else None,
                "center_of_mass": payload.center_of_mass.tolist() if payload else [0.0, 0.0, 0.0],
            },
            f"largest_tried_{unit}": self.most,
            "samples": self.drawn[0],
            "seed": self.drawn[1],
            "postures": len(self.q),
            f"broken_without_{key}": self.broken,
            "center_m": [*feet[:, :2].mean(axis=0), feet[:, 2].min()],
            "edges": {
                "azimuth_deg": np.round(np.degrees(self.edges[0]), 9),
                "reach_m": self.edges[1],
                "height_m": self.edges[2],
            },
            "side": [one.to_dict(key, unit) for one in self.cells(azimuth=False)],
            "plan": [one.to_dict(key, unit) for one in self.cells(height=False)],
            "cells": [one.to_dict(key, unit) for one in self.cells()],
            "reach_by_azimuth": [
                {
                    f"{key}_{unit}": one.level,
                    "any_posture_m": list(one.any_posture),
                    "best_posture_m": list(one.best_posture),
                }
                for one in self.reaches
            ],
            "designs": [one.to_dict(key, unit) for one in self.designs],
            "versions": versions(),
        }

    def to_csv(self) -> str:
        """The cells as a table; empty: all around, or all heights."""
        stream = io.StringIO()
        rows = csv.writer(stream, lineterminator="\n")
        ends = [f"{name}_{end}_{unit}" for name, unit in _COLUMNS for end in ("from", "to")]
        key, unit = self._key
        names = [f"{key}_any_posture_{unit}", "limit", f"{key}_best_posture_{unit}", "limit_best_posture"]
        rows.writerow(["view", *ends, "postures", *names])
        views = {"side": {"azimuth": False}, "plan": {"height": False}, "cells": {}}
        for view, use in views.items():
            for data in (one.to_dict(key, unit) for one in self.cells(**use)):
                places = [end for name, unit in _COLUMNS for end in data[f"{name}_{unit}"] or ("", "")]
                rows.writerow([view, *places, data["postures"], *(data[name] for name in names)])
        return stream.getvalue()

    def designs_csv(self) -> str:
        """The levels of the designs as a table: one row per base or speed, and reach."""
        stream = io.StringIO()
        rows = csv.writer(stream, lineterminator="\n")
        rows.writerow(["changed", "value", "reach_to_m", "_".join(self._key)])
        for one in self.designs:
            for reach, level in zip(self.edges[1][1:], one.levels, strict=True):
                rows.writerow([one.quantity, one.value, reach, "" if level is None else level])
        return stream.getvalue()

    def picture(self) -> bytes:
        """The content of chart.png."""
        words = self.name, self.raised.title, self.raised.unit, self.scope
        cells = self.cells(azimuth=False)
        return png(chart_figure(words, self.edges, cells, self.reaches, self._feet), small=True)

    @property
    def _key(self) -> tuple[str, str]:
        """What is charted, and its unit: parts of keys."""
        return self.raised.name, self.raised.unit

    def contents(self, figures: bool) -> dict[str, bytes]:
        """chart.csv and chart.png."""
        files = {"chart.csv": self.to_csv().encode()}
        if self.designs:
            files["design.csv"] = self.designs_csv().encode()
        if figures:
            files["chart.png"] = self.picture()
            if self.designs:
                files["design.png"] = design_picture(
                    (self.name, self.raised.name, self.raised.unit, self.scope), self.edges[1], self.designs
                )
        return files


_COLUMNS = (("azimuth", "deg"), ("reach", "m"), ("height", "m"))


def _edges(low: float, values: np.ndarray, step: float | None) -> np.ndarray:
    """Ends of cells from `low`, m, at multiples of a step; default: the smallest one with few cells."""
    high = float(np.max(values, initial=low))
    if step is None:
        step = next((one for one in _STEPS if _count(low, high, one) <= _CELLS), _STEPS[-1])
    first = np.floor(low / step + 1e-9)
    return np.round(step * (first + np.arange(_count(low, high, step) + 1)), 9)


def _count(low: float, high: float, step: float) -> int:
    return max(1, int(np.ceil(high / step - 1e-9) - np.floor(low / step + 1e-9)))
