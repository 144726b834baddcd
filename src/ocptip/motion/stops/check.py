"""Stops of a motion, begun at any instant: along its path, by brakes, by a controller that is cancelled.

Along the path is category 1 and 2, by brakes category 0. Categories of IEC 60204-1: 0 takes the drives' power
away at once, 1 after a controlled stop, 2 leaves it on.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ocptip.basics.errors import InputError
from ocptip.basics.text import percent, quantity
from ocptip.motion.check import MotionCheck, of_stops
from ocptip.motion.cycles.check import CycleCheck
from ocptip.motion.cycles.task import Task
from ocptip.motion.stops.broken import CLOSE
from ocptip.motion.stops.cancels import SafeDecelerations, safe_decelerations
from ocptip.motion.stops.rules import BRAKES, HOLDING, SCENARIOS, Kinds, StopRules, kinds_of
from ocptip.motion.stops.tables import BrakeTable, CancelTable, JointTable, PathTable
from ocptip.motion.task import MotionTask
from ocptip.motion.violations import stated, statement
from ocptip.numerics.threads import one_thread
from ocptip.standing.arm import Robot
from ocptip.standing.contact_margins import of_friction
from ocptip.standing.limit_kinds.limit import Worst
from ocptip.standing.limits import Limits
from ocptip.standing.mechanism import StandingMechanism
from ocptip.standing.within.in_motion import ALIKE
from ocptip.trajectories.trajectory import Trajectory

ROWS = 12  # of the table
_SHOWN = 5e-4  # s: what is earlier is at once
ASSUMED_BRAKES = f"{BRAKES[0]:g} to {BRAKES[1]:g} times the torque limits, a guess"
_BY_JOINT = {"brakes": "power off, by brakes (category 0)", "cancel": "cancel"}


@dataclass(frozen=True, eq=False)
class Stops:
    """The check of the stops of a motion.

    Attributes:
        kinds: which scenarios were checked, see `SCENARIOS`.
        verified: no stop breaks a limit.
        violations: broken limits of stops in which every joint stops by itself (those along the path are in
            the check).
        unknown: what breaks limits only with brake torques that were assumed; empty: nothing.
        worst: by scenario ("path", "brakes", "cancel"), plain data with units in the keys: `GN`, `GT`,
            `begun_s`, `after_s`, ...
        times: (K,), s: instants of the table.
        speeds: by scenario (K,), largest safe share of the planned speed, at most 1, for stops begun there.
        durations: by scenario (K,), s, that stops from the planned speed take.
        curve: (2, M): times, s, and shares for stops along the path at all places; for figures.
        assumed: what was assumed, one sentence each.
        decelerations: which are safe when the motion is cancelled; None if not checked.
    """

    kinds: Kinds
    verified: bool
    violations: tuple[Worst, ...]
    worst: dict[str, dict[str, Any]]
    times: np.ndarray
    speeds: dict[str, np.ndarray]
    durations: dict[str, np.ndarray]
    curve: np.ndarray | None
    assumed: tuple[str, ...]
    decelerations: SafeDecelerations | None = None
    unknown: tuple[Worst, ...] = ()

    @property
    def slips_alike(self) -> bool:
        """Whether equally compliant feet slip in a stop of the base, also within the uncertainty."""
        worst = (max(_alike(one), default=0.0) for one in self.worst.values())
        return max(worst, default=0.0) >= 1 or bool(self.decelerations and self.decelerations.slips_alike)

    @property
    def summary(self) -> list[str]:
        """In words: the worst of each category."""
        results = []
        if path := self.worst.get("path"):
            share = float(np.min(self.speeds["path"]))
            safe = "the planned speed" if share == 1 else f"{100 * share:.0f} % of the planned speed"
            longest = f"rests within {path['longest_stop_s']:.3f} s, safe up to {safe}"
            scope = _scope(path)
            results.append(f"along the path (category 1 and 2){scope}: {_contact_text(path)}, {longest}")
        for kind, title in _BY_JOINT.items():
            if worst := self.worst.get(kind):
                later = f", {worst['after_s']:.3f} s later" if worst["after_s"] >= _SHOWN else ""
                text = f"{_contact_text(worst)}, worst when stopped at {worst['begun_s']:.3f} s{later}"
                if kind == "brakes" and self.unknown:
                    text = f"not known, brake torques are not given. With {ASSUMED_BRAKES}: {text}"
                results.append(f"{title}{_scope(worst)}: {text}")
        return results

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        columns = {"time_s": self.times}
        for kind, speeds in self.speeds.items():
            columns |= {f"{kind}_safe_speed": speeds, f"{kind}_stop_s": self.durations[kind]}
        known = {
            name: [value if np.isfinite(value) else None for value in values.tolist()]
            for name, values in columns.items()
        }
        table = [dict(zip(known, row, strict=True)) for row in zip(*known.values(), strict=True)]
        return {
            "kinds": self.kinds,
            "verified": self.verified,
            "violations": stated(self.violations),
            **({"unknown": stated(self.unknown)} if self.unknown else {}),
            "worst": self.worst,
            "safe_speed_by_time": table,
            **({"decelerations": self.decelerations.to_dict()} if self.decelerations else {}),
            "assumed": list(self.assumed),
        }


@one_thread
def check_stops(
    robot: StandingMechanism,
    motion: Trajectory,
    limits: Limits,
    rules: StopRules,
    checked: MotionCheck,
    kinds: Kinds = "both",
    decelerations: bool = True,
) -> Stops:
    """Check stops of a motion.

    Args:
        robot, motion: whose.
        limits: of the motion, with stops along the path if these are checked: see `StopRules.asked`.
        rules: how it is stopped.
        checked: the motion's check under these limits, which includes the stops that they ask for.
        kinds: which scenarios; by brakes and cancels of arms only.
        decelerations: also determine which are safe in cancels; takes most of the time.

    Raises:
        InputError: brake torques or decelerations are missing or too many, or nothing bounds stops along
            the path.
    """
    times = np.linspace(0, motion.end, ROWS + 1)[:-1] + motion.end / (2 * ROWS)
    asked = SCENARIOS[kinds]
    if asked == ("cancel",) and robot.arm is None:
        raise InputError("stops: cancels are not computed for parallel robots")
    tables: dict[str, PathTable | JointTable] = {}
    curve = safe_range = None
    if "path" in asked:
        tables["path"] = path = PathTable(robot, motion, limits, times, checked)
        curve = path.curve
    lacking = rules.lacking(robot) if "brakes" in asked and not limits.brakes else ""
    if robot.arm is not None:
        robot = Robot.of(robot)
        if "brakes" in asked and not lacking:
            brakes = limits.brakes or rules.safe(limits, robot, "brakes").brakes
            assert brakes is not None
            tables["brakes"] = BrakeTable(robot, motion, limits, brakes, times)
        if "cancel" in asked:
            cancel = limits.cancel or rules.cancel(robot, limits)
            tables["cancel"] = CancelTable(robot, motion, limits, cancel, times)
            if decelerations:
                full = rules.cancel(robot, limits, 1.0)
                how = {"of_limits": rules.of_limits, "most": rules.share}
                safe_range = safe_decelerations(robot, motion, limits, full, **how)
    assumed = rules.guessed and limits.brakes is None  # then what breaks a limit may not in truth
    broken = {kind: table.violations() for kind, table in tables.items()}
    unknown = [statement(lacking)] if lacking else broken.pop("brakes", []) if assumed else []
    violations = [one for every in broken.values() for one in every]
    kept = all(worst.excess <= CLOSE for name, worst in checked.worst.items() if of_stops(name))
    return Stops(
        kinds=kinds,
        verified=kept and not violations and not unknown,
        violations=tuple(violations),
        worst={kind: table.worst() for kind, table in tables.items()},
        times=times,
        speeds={kind: table.speeds for kind, table in tables.items()},
        durations={kind: table.durations for kind, table in tables.items()},
        curve=curve,
        assumed=_assumed(robot, rules, asked, lacking, 0.0 if limits.stops is None else limits.stops.time),
        decelerations=safe_range,
        unknown=tuple(unknown),
    )


def stops_of(
    task: MotionTask,
    motion: Trajectory,
    checked: MotionCheck,
    kinds: Kinds | None = None,
    decelerations: bool = True,
) -> Stops | None:
    """Stops of the kinds asked for, or else of those that the task's limits ask for; else None."""
    limits = task.limits
    if kinds is None:
        if not limits.stoppable:
            return None
        given = {"path": limits.stops, "brakes": limits.brakes, "cancel": limits.cancel}
        kinds = kinds_of(name for name, item in given.items() if item is not None)
    if limits.stops is None and "path" in SCENARIOS[kinds]:
        limits = task.stops.asked(limits)
    return check_stops(task.robot, motion, limits, task.stops, checked, kinds, decelerations)


def stops_by_segment(
    task: Task,
    motion: Trajectory,
    checked: CycleCheck,
    kinds: Kinds | None = None,
    decelerations: bool = True,
) -> dict[str, Stops]:
    """The checked stops by the names of segments, in their times; the name of a motion is empty."""
    rows = zip(task.segments, motion.segments, checked.segments, strict=True)
    table = {
        segment.name: stops_of(segment.task, segment_motion, check, kinds, decelerations)
        for segment, segment_motion, check in rows
    }
    return {name: stops for name, stops in table.items() if stops}


def cancels_by_segment(task: Task, motion: Trajectory) -> dict[str, SafeDecelerations]:
    """Safe decelerations of a cancelled controller, by the names of segments.

    None of parallel robots, and while the base drives. Coarse: at `SHARES` only, so
    that it takes little beside a plan. `check_stops` determines the ends.
    """
    table = {}
    for segment, segment_motion in zip(task.segments, motion.segments, strict=False):
        robot, limits, rules = segment.task.robot, segment.task.limits, segment.task.stops
        if robot.arm is None or robot.acts.end:
            continue
        if np.isfinite(robot.limits.acceleration).all():
            how = {"of_limits": rules.of_limits, "close": 1.0}
            full = rules.cancel(Robot.of(robot), limits, 1.0)
            table[segment.name] = safe_decelerations(Robot.of(robot), segment_motion, limits, full, **how)
    return table


def stops_to_dict(task: Task, stops: Mapping[str, Stops]) -> dict[str, Any]:
    """An entry for JSON: of a motion, or of a cycle one by segment; none if they were not asked for."""
    return _by_segment(task, "stops", stops)


def cancels_to_dict(task: Task, cancels: Mapping[str, SafeDecelerations]) -> dict[str, Any]:
    """An entry for JSON about safe decelerations of a cancelled controller."""
    return _by_segment(task, "cancel", cancels)


def _by_segment(task: Task, key: str, result: Mapping[str, Stops | SafeDecelerations]) -> dict[str, Any]:
    if not result:
        return {}
    rows = [{"segment": name, **item.to_dict()} for name, item in result.items()]
    return {key: rows if task.is_cycle else result[""].to_dict()}


def _alike(worst: Mapping[str, Any]) -> list[float]:
    """Shares of the friction that equally compliant feet use, nominal and within the uncertainty."""
    return [worst[name] for name in (ALIKE, f"{ALIKE}_within") if name in worst]


def _scope(worst: Mapping[str, Any]) -> str:
    """That an uncertainty does not count; empty where worst cases stand beside nominal values."""
    return "" if any("_within" in name for name in worst) else ", in the nominal model"


def _contact_text(worst: Mapping[str, Any], name: str = "the base") -> str:
    """The worst of the contacts, in N m and per cent; beyond 1, indices measure no margin.

    Of several objects it is the critical one.
    """
    texts, within = [], worst.get("GN_within")
    if (GN := worst.get("GN")) is not None:
        margin = f"tipping margin >= {quantity(worst['tipping_margin_Nm'], 'N m', 3)}"
        if within is not None:
            least = f">= {quantity(worst['tipping_margin_within_Nm'], 'N m', 3)}"
            margin += f" (worst case {f'{name} tips' if within >= 1 else least})"
        texts.append(f"{name} tips" if GN >= 1 else margin)
    if (GT := worst.get("GT")) is not None:
        used = f"friction used <= {percent(GT)}"
        if (within := worst.get("GT_within")) is not None:
            used += f" (worst case {f'{name} slips' if within >= 1 else f'<= {percent(within)}'})"
        texts.append(f"{name} slips" if GT >= 1 else used)
    if alike := _alike(worst):
        texts.append(f"equally compliant feet use at least {of_friction(max(alike))}")
    if objects := worst.get("objects"):
        critical = max(objects, key=lambda one: max(objects[one].get("GN", 0.0), objects[one].get("GT", 0.0)))
        texts.append(f"of objects {critical} is critical: {_contact_text(objects[critical], critical)}")
    return ", ".join(texts)


def _assumed(
    robot: StandingMechanism, rules: StopRules, asked: Sequence[str], lacking: str, time: float
) -> tuple[str, ...]:
    texts = []
    if robot.support.elastic is not None:
        texts.append("compliant feet: their forces and lifts during stops are not checked, only GN and GT")
    if "path" in asked:
        hardest = "as hard as limits of torque and acceleration allow, and all gentler ones"
        if time > 0:
            hardest = f"from full speed to rest in {time:g} s or more within the drives' limits"
        texts.append(f"stops along the path (category 1 and 2): {hardest}; every instant of the check")
    if robot.arm is None:
        return (*texts, "stops by brakes (category 0) and cancels: not computed for parallel robots")
    if "cancel" in asked:
        when = f"beginning within {1e3 * rules.reaction:g} ms" if rules.reaction else "at once"
        law = (
            "each joint decelerates by itself" if rules.stopj is None else "all joints come to rest together"
        )
        texts.append(f"cancel: {law}, {when}; the drives follow as commanded")
        if rules.of_limits:
            texts.append(
                "cancel: 100 % is the acceleration limit; harder braking than checked is not covered"
            )
        if robot.acts.end:
            rate = rules.base_deceleration
            braking = f"brakes with {rate:g} m/s^2 when the joints do, the radius of its curve stays"
            texts.append(f"cancel: the base {braking if rate else 'drives on as its profile says'}")
        if not robot.arm.may_collide:
            texts.append("cancel: collisions not checked, no collision geometry")
    if "brakes" not in asked:
        return (*texts, "stops by brakes when power is off (category 0): not checked")
    if lacking:
        return (*texts, lacking)
    given = "as given"
    if rules.guessed:
        given = (
            f"{ASSUMED_BRAKES}, at least {HOLDING:g} times what gravity asks in any posture; give "
            "brake_torque_min_Nm, _max_Nm in [stops]"
        )
    delay = "at once" if rules.delay[1] == 0 else f"after {rules.delay[0]:g} to {rules.delay[1]:g} s"
    texts.append(f"stops by brakes: they act {delay}, torques are {given}; constant torques while braking")
    if robot.varying is not None:
        texts.append("stops by brakes: what acts on the gripper stays what it is when the stop begins")
    if not robot.arm.may_collide:
        texts.append("stops by brakes: collisions not checked, no collision geometry")
    return tuple(texts)
