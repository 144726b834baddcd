"""`ocptip.chart`: load charts of a robot on its base, as crane and lift makers hand them out."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import scipy  # subpackages load on first use: that of the sequence takes a second

from ocptip.api.inputs.postures import rests_of
from ocptip.api.tasks import TaskLike, load_task
from ocptip.basics.errors import InputError, finite_array, positive_number, whole_number
from ocptip.basics.outputs import SavedFolder
from ocptip.basics.text import quantity
from ocptip.basics.write import versions
from ocptip.contact.support import Support
from ocptip.pictures.load_chart import chart_picture, design_picture
from ocptip.standing.arm import Robot
from ocptip.standing.at_rest.largest_payload import (
    ChartCell,
    LargestPayloads,
    ReachBySector,
    largest_payloads,
)
from ocptip.standing.limits import SLIP_WITHIN, TIP_WITHIN, TORQUE_WITHIN, Limits
from ocptip.standing.tolerance import Uncertainty
from ocptip.standing.within.design import BALLAST, FOOT_WIDTH, BasePayloads, ballasted, widened
from ocptip.standing.within.tolerable import AT_REST

SAMPLES, SECTORS = 10_000, 8
NOT_COVERED = ("motion", "process forces that vary", "postures that were not sampled")
_QUANTILES = (0.1, 0.3, 0.6, 0.9)
"""Payloads of the reaches, as shares of the task's payload, or of the largest one."""

_STEPS = (0.05, 0.1, 0.2, 0.25, 0.5, 1.0, 2.0, 5.0)  # m
_CELLS = 8  # cells of reach or height, at most
_TIMES_RATED = 10.0  # largest payload tried


def chart(
    task: TaskLike,
    *,
    uncertainty: Uncertainty | str | None = None,
    samples: int = SAMPLES,
    seed: int = 0,
    payloads: Sequence[float] | None = None,
    sectors: int = SECTORS,
    cell: float | None = None,
    most: float | None = None,
    ballast: Sequence[float] = (),
    foot_width: Sequence[float] = (),
) -> LoadChart:
    """Return the largest payload at rest over reach, height and azimuth of the TCP.

    Example::

        found = ocptip.chart("examples/tasks/kit_arm.toml", samples=2000)
        print(found)
        found.save("chart")

    Args:
        task: a task of an arm, its file, or a published case.
        uncertainty: what the limits hold within, an object, a preset ("workshop", "none") or a TOML file with
            a table `[tolerance]`. Default: that of the task, else "workshop".
        samples: postures that are drawn within the joint limits (a Halton sequence); what collides is
            dropped.
        seed: of the sequence.
        payloads: kg, of the reaches by azimuth; default: none, the task's payload, and what 90, 70, 40 and
            10 % of the postures hold, rounded.
        sectors: of the azimuth.
        cell: m, size of the cells of reach and height; default: at most 8 of each.
        most: kg, the largest payload that is tried; default: ten times the task's payload, else the mass of
            robot and base.
        ballast: kg at the centre of mass of the base, for each of which payloads are also computed.
        foot_width: factors on the horizontal distances of the contacts from their middle, likewise.

    Raises:
        InputError: the robot is no arm, or a value cannot be used.
    """
    for name, value, least in (("samples", samples, 1), ("seed", seed, 0), ("sectors", sectors, 1)):
        whole_number(name, value, least)
    for size in ballast:
        positive_number("ballast", size, zero_allowed=True)
    for size in foot_width:
        positive_number("foot_width", size)
    result = load_task(task, uncertainty=uncertainty)
    robot, _, limits = rests_of(result)["start"]
    robot.require_no_objects("chart")
    robot = Robot.of(robot, "task: load charts are for arms; this robot is a parallel one")
    rated = robot.payload.mass if robot.payload else None
    if most is None:
        most = _TIMES_RATED * rated if rated else robot.mass
    most = positive_number("most", most)
    drawn = halton_postures(robot, limits, samples, seed)
    gaps = robot.collision.gaps(drawn, limits.clearance)
    q = drawn[np.all(gaps >= limits.clearance, axis=1)]
    held = largest_payloads(robot, limits, q, most)
    masses = _different(held, rated) if payloads is None else finite_array("payloads", payloads, (None,))
    if np.any(masses < 0):
        raise InputError(f"payloads: must be >= 0 kg, got {masses.tolist()}")
    made = LoadChart.of(result.name, robot, limits, q, held, (samples, seed), masses, sectors, cell, most)
    bases = [(BALLAST, size, ballasted(robot.support, robot.support.mass + size)) for size in ballast]
    bases += [(FOOT_WIDTH, size, widened(robot.support, size)) for size in foot_width]
    return replace(made, designs=tuple(made.on_base(*base) for base in bases))


def _different(held: LargestPayloads, rated: float | None) -> np.ndarray:
    """Payloads, kg, ascending, whose reaches differ: those that most, some and few postures hold."""
    masses = held.masses[held.unloaded]
    result = np.quantile(masses, _QUANTILES) if len(masses) else np.empty(0)
    return np.unique([0.0, *([rated] if rated else []), *(float(f"{mass:.2g}") for mass in result)])


def halton_postures(robot: Robot, limits: Limits, samples: int, seed: int) -> np.ndarray:
    """(N, n) postures within the joint limits; a joint without limits turns once, or slides 1 m."""
    ends, turns = robot.arm.limits, np.array([unit == "rad" for unit in robot.units])
    margin = np.where(turns, limits.angle_margin, 0.0)
    usual = np.where(turns, np.pi, 0.5)
    low = np.where(np.isfinite(ends.angle_min), ends.angle_min + margin, -usual)
    high = np.where(np.isfinite(ends.angle_max), ends.angle_max - margin, usual)
    # A whole turn is enough: beyond it postures repeat.
    middle = (low + high) / 2
    half = np.where(turns, np.minimum((high - low) / 2, np.pi), (high - low) / 2)
    unit = scipy.stats.qmc.Halton(robot.n, rng=np.random.default_rng(seed)).random(samples)
    return middle + (2 * unit - 1) * half


@dataclass(frozen=True, eq=False, repr=False)
class LoadChart(SavedFolder):
    """Load charts of a robot at rest.

    Attributes:
        name: of the task.
        robot: on its base, as it rests.
        limits: that are kept, with the uncertainty.
        q: (N, n), rad (prismatic joints: m): the postures that do not collide.
        held: their largest payloads, and what limits them.
        places: (N, 3): azimuth, rad, from the base's x axis to y; reach, m, the horizontal distance of the
            TCP from the centre of the contacts; height, m, above the lowest contact.
        drawn: number of postures that were drawn, and the seed.
        edges: of the cells: azimuth, rad, reach and height, m.
        payloads: kg, of the reaches by azimuth.
        most: kg, the largest payload that was tried.
        designs: payloads on changed bases; empty if not asked for.
    """

    data_file = "chart.json"
    name: str
    robot: Robot
    limits: Limits
    q: np.ndarray
    held: LargestPayloads
    places: np.ndarray
    drawn: tuple[int, int]
    edges: tuple[np.ndarray, np.ndarray, np.ndarray]
    payloads: np.ndarray
    most: float
    designs: tuple[BasePayloads, ...] = ()

    @classmethod
    def of(
        cls,
        name: str,
        robot: Robot,
        limits: Limits,
        q: np.ndarray,
        held: LargestPayloads,
        drawn: tuple[int, int],
        payloads: np.ndarray,
        sectors: int,
        cell: float | None,
        most: float,
    ) -> LoadChart:
        """The chart with its cells."""
        feet = np.array([contact.position for contact in robot.support.contacts])
        tool = robot.tool(q) - [*feet[:, :2].mean(axis=0), feet[:, 2].min()]
        reach = np.hypot(tool[:, 0], tool[:, 1])
        # Sectors are about their middle, so that straight ahead is one of them.
        turn = 2 * np.pi / sectors
        azimuth = (np.arctan2(tool[:, 1], tool[:, 0]) + turn / 2) % (2 * np.pi) - turn / 2
        around = turn * (np.arange(sectors + 1) - 0.5)
        step = None if cell is None else positive_number("cell", cell)
        edges = (
            around,
            _edges(0.0, reach, step),
            _edges(float(tool[:, 2].min()) if len(q) else 0.0, tool[:, 2], step),
        )
        places = np.column_stack([azimuth, reach, tool[:, 2]])
        return cls(name, robot, limits, q, held, places, drawn, edges, payloads, most)

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
        masses = self.held.masses[rows]
        least, best = rows[np.argmin(masses)], rows[np.argmax(masses)]
        assert ends[1] is not None  # reach is always used
        return ChartCell(
            ends[0],
            ends[1],
            ends[2],
            len(rows),
            float(self.held.masses[least]),
            float(self.held.masses[best]),
            self._limit(least),
            self._limit(best),
        )

    def _limit(self, row: int) -> str:
        broken = "" if self.held.unloaded[row] else " without payload"
        return self.held.names[self.held.limits[row]] + broken

    def on_base(self, what: str, value: float, support: Support) -> BasePayloads:
        """What all postures up to each reach hold on another base; what and value say how it differs."""
        held = largest_payloads(self.robot.varied(support=support), self.limits, self.q, self.most)
        return BasePayloads(what, float(value), self._within(held))

    def _within(self, held: LargestPayloads) -> tuple[float | None, ...]:
        """kg that all postures up to each reach hold."""
        masses, index = np.where(held.unloaded, held.masses, 0.0), self._index[:, 1]
        within = [masses[index <= k] for k in range(len(self.edges[1]) - 1)]
        return tuple(float(column.min()) if len(column) else None for column in within)

    @cached_property
    def reaches(self) -> tuple[ReachBySector, ...]:
        """Largest reach by azimuth of each of the payloads."""
        results, sector, reach = [], self._index[:, 0], self.places[:, 1]
        for payload in self.payloads:
            holds = self.held.unloaded & (self.held.masses >= payload)
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
            results.append(ReachBySector(float(payload), *(tuple(one) for one in zip(*ends, strict=True))))
        return tuple(results)

    @property
    def _feet(self) -> np.ndarray:
        """(n, 3), m, base frame: the contacts."""
        return np.array([contact.position for contact in self.robot.support.contacts])

    @property
    def summary(self) -> str:
        """The payload of all postures, and of those up to half of the reach."""
        if not len(self.q):
            return "no posture drawn keeps the clearance"
        masses, half = self._within(self.held), (len(self.edges[1]) - 2) // 2
        known = [(k, mass) for k, mass in enumerate(masses) if mass is not None]
        near = next(((k, mass) for k, mass in known if k >= half), known[-1])
        ends = [f"{self.edges[1][k + 1]:.3g} m: {quantity(mass, 'kg', 3)}" for k, mass in (near, known[-1])]
        return f"payload of all postures up to a reach of {', '.join(dict.fromkeys(ends))}"

    @property
    def broken(self) -> int:
        """Number of postures that break a limit without any payload."""
        return int(np.sum(~self.held.unloaded))

    @property
    def scope(self) -> str:
        """What the chart is about, in words: static, uncertainty, samples, seed."""
        tolerance = self.limits.tolerance
        within = f"within {tolerance.scope}" if tolerance.given else "nominal model only"
        return f"static, {within}, {len(self.q)} of {self.drawn[0]} postures, seed {self.drawn[1]}"

    @property
    def ignored(self) -> tuple[str, ...]:
        """Deviations of the uncertainty that need motion."""
        tolerance = self.limits.tolerance
        return tuple(str(tolerance.only(name)) for name in tolerance.given if name not in AT_REST)

    def __repr__(self) -> str:
        """The scope, and the smallest and largest payload."""
        masses = self.held.masses
        held = f"{masses.min():.3g} to {masses.max():.3g} kg" if len(masses) else "no posture"
        return f"<LoadChart {self.name}: {held}; {self.scope}>"

    def to_dict(self) -> dict[str, Any]:
        """The content of chart.json; see docs/how-to/load-charts.md."""
        limits, payload = self.limits, self.robot.payload
        names = ("GN", "GT", "torque_ratio", "clearance")
        within = TIP_WITHIN, SLIP_WITHIN, TORQUE_WITHIN
        given = limits.tolerance.given
        feet = self._feet
        return {
            "task": self.name,
            "scope": self.scope,
            "not_covered": [*NOT_COVERED, *self.ignored],
            "tolerance": limits.tolerance.to_dict(),
            "limits": {name: getattr(limits, name) for name in (*names, *(within if given else ()))},
            "payload": {
                "rated_kg": payload.mass if payload else None,
                "center_of_mass": payload.center_of_mass.tolist() if payload else [0.0, 0.0, 0.0],
                "largest_tried_kg": self.most,
            },
            "samples": self.drawn[0],
            "seed": self.drawn[1],
            "postures": len(self.q),
            "broken_without_payload": self.broken,
            "center_m": [*feet[:, :2].mean(axis=0), feet[:, 2].min()],
            "edges": {
                "azimuth_deg": np.round(np.degrees(self.edges[0]), 9),
                "reach_m": self.edges[1],
                "height_m": self.edges[2],
            },
            "side": [one.to_dict() for one in self.cells(azimuth=False)],
            "plan": [one.to_dict() for one in self.cells(height=False)],
            "cells": [one.to_dict() for one in self.cells()],
            "reach_by_azimuth": [
                {
                    "payload_kg": one.payload,
                    "any_posture_m": list(one.any_posture),
                    "best_posture_m": list(one.best_posture),
                }
                for one in self.reaches
            ],
            "designs": [one.to_dict() for one in self.designs],
            "versions": versions(),
        }

    def to_csv(self) -> str:
        """The cells as a table; empty: all around, or all heights."""
        stream = io.StringIO()
        rows = csv.writer(stream, lineterminator="\n")
        ends = [f"{name}_{end}_{unit}" for name, unit in _COLUMNS for end in ("from", "to")]
        rows.writerow(["view", *ends, "postures", *_VALUES])
        views = {"side": {"azimuth": False}, "plan": {"height": False}, "cells": {}}
        for view, use in views.items():
            for data in (one.to_dict() for one in self.cells(**use)):
                places = [end for name, unit in _COLUMNS for end in data[f"{name}_{unit}"] or ("", "")]
                rows.writerow([view, *places, data["postures"], *(data[name] for name in _VALUES)])
        return stream.getvalue()

    def designs_csv(self) -> str:
        """The payloads on changed bases as a table: one row per base and reach."""
        stream = io.StringIO()
        rows = csv.writer(stream, lineterminator="\n")
        rows.writerow(["changed", "value", "reach_to_m", "payload_kg"])
        for one in self.designs:
            for reach, payload in zip(self.edges[1][1:], one.payloads, strict=True):
                rows.writerow([one.quantity, one.value, reach, "" if payload is None else payload])
        return stream.getvalue()

    def picture(self) -> bytes:
        """The content of chart.png."""
        views = self.cells(azimuth=False), self.cells(height=False)
        return chart_picture(self.name, self.scope, self.edges, *views, self.reaches, self._feet)

    def contents(self, figures: bool) -> dict[str, bytes]:
        """chart.csv and chart.png."""
        files = {"chart.csv": self.to_csv().encode()}
        if self.designs:
            files["design.csv"] = self.designs_csv().encode()
        if figures:
            files["chart.png"] = self.picture()
            if self.designs:
                files["design.png"] = design_picture(self.name, self.scope, self.edges[1], self.designs)
        return files


_COLUMNS = (("azimuth", "deg"), ("reach", "m"), ("height", "m"))
_VALUES = ("payload_any_posture_kg", "limit", "payload_best_posture_kg", "limit_best_posture")


def _edges(low: float, values: np.ndarray, step: float | None) -> np.ndarray:
    """Ends of cells from `low`, m, at multiples of a step; default: the smallest one with few cells."""
    high = float(np.max(values, initial=low))
    if step is None:
        step = next((one for one in _STEPS if _count(low, high, one) <= _CELLS), _STEPS[-1])
    first = np.floor(low / step + 1e-9)
    return np.round(step * (first + np.arange(_count(low, high, step) + 1)), 9)


def _count(low: float, high: float, step: float) -> int:
    return max(1, int(np.ceil(high / step - 1e-9) - np.floor(low / step + 1e-9)))
