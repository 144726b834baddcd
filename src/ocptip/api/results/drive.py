"""The result of `ocptip.drive`: limits of a driving base in all directions, on slopes and in curves."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from ocptip.api.results.drive_arguments import DriveArguments
from ocptip.api.results.drive_files import limits_csv, manoeuvre_limits, smoother_yaml
from ocptip.api.results.smoother import Smoother
from ocptip.basics.errors import positive_number
from ocptip.basics.outputs import SavedFolder
from ocptip.basics.write import versions
from ocptip.pictures.frame import png
from ocptip.pictures.load_chart import envelope_figure
from ocptip.standing.arm import Robot
from ocptip.standing.at_rest.drive_envelope import LargestManoeuvres, largest_manoeuvres
from ocptip.standing.at_rest.drive_states import worst_states
from ocptip.standing.at_rest.manoeuvres import LARGEST, Manoeuvre, Manoeuvres
from ocptip.standing.tolerance import NONE, Uncertainty
from ocptip.trajectories.trajectory import Trajectory

ASSUMED = "contacts with friction are wheels that drive and brake up to it: torques of wheels are not limited"
NOT_COVERED = ("swing on compliant wheels, and their friction once one lifts", "uneven floor")
_NOISE = 1e-9  # relative: a contact that lifts where the base tips
_SAME = 1e-6  # relative: limits that differ by rounding
_NONE = (0.0,)
_SPACING = 0.02  # s: between instants of a motion


@dataclass(frozen=True, eq=False, repr=False)
class DriveEnvelope(SavedFolder):
    """How hard a base may accelerate, brake and turn.

    Attributes:
        name: of task and posture.
        robot: on its base.
        q: (n,), rad (prismatic joints: m), at the start of a motion.
        tolerance: the uncertainty.
        counting: what of it counts.
        given: arguments of :func:`drive`.
        motion: of the arm; None: it rests.
        interface: of the robot's `interfaces`, whose contacts limit manoeuvres; 0: the base.
        choice: that the posture is one of several of its pose, one sentence; else empty.
        broken: why the arm cannot rest in the posture: torques, angles, clearance.
    """

    data_file = "drive.json"
    name: str
    robot: Robot
    q: np.ndarray
    tolerance: Uncertainty
    counting: Uncertainty
    given: DriveArguments
    motion: Trajectory | None = None
    interface: int = 0
    choice: str = ""
    broken: tuple[str, ...] = ()

    @property
    def stands(self) -> bool:
        """The base stands in the posture, so that it may accelerate in all directions."""
        return self.worst_direction[0] > 0

    @cached_property
    def angles(self) -> np.ndarray:
        """(D,) rad, directions of acceleration, from the x axis of the base to y."""
        return 2 * np.pi * np.arange(self.given.directions) / self.given.directions

    @property
    def manoeuvres(self) -> tuple[Manoeuvre, ...]:
        """Those beside the directions."""
        return self.given.manoeuvres

    @property
    def stops(self) -> tuple[str, str]:
        """The stops in turns, and those whose largest speed is computed, in words."""
        given = self.given
        return (
            f"stop in a turn: from {given.speed:.4g} m/s turning at {given.turning:.4g} rad/s",
            f"speed for a stop: at {self.stop_deceleration:.3g} m/s^2 in a curve of {self._radius:.3g} m",
        )

    @property
    def _radius(self) -> float:
        """m, of the curve of the emergency stop."""
        return self.given.speed / self.given.turning

    @cached_property
    def stop_deceleration(self) -> float:
        """m/s^2: of the emergency stop whose largest speed is computed; by default 80 % of the largest.

        The largest is that at low speed in the curve.
        """
        if self.given.deceleration is not None:
            return positive_number("deceleration", self.given.deceleration)
        every = (replace(self, interface=k) for k in range(len(self.robot.interfaces)))
        return 0.8 * min(float(np.min(envelope._worst_of(self._curved).largest)) for envelope in every)

    @cached_property
    def objects(self) -> dict[str, DriveEnvelope]:
        """Envelopes of the objects by name; of a base, else there are none."""
        names = [interface.name for interface in self.robot.interfaces] if not self.interface else []
        given = replace(self.given, deceleration=self.stop_deceleration) if names[1:] else self.given
        return {name: replace(self, interface=k, given=given) for k, name in enumerate(names) if k}

    # Each builder takes the share of the acceleration that acts: 1; more when it sets in at once and
    # overshoots; less than 0 when it ends and the load swings back, which is at rest for stops.

    def _straight(self, share: float) -> Manoeuvres:
        level = share * np.array([[1.0, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]])
        return Manoeuvres.accelerations(level, self.robot.support.gravity)

    def _curved(self, share: float) -> Manoeuvres:
        """Braking along curves to the left and to the right."""
        rows = np.zeros((2, 9))
        rows[:, 0], rows[:, 8] = -share, -share * np.array([1, -1]) / self._radius
        return Manoeuvres.along(rows, self.robot.support.gravity)

    def _all(self, share: float) -> Manoeuvres:
        given, gravity = self.given, self.robot.support.gravity
        around = np.column_stack([np.cos(self.angles), np.sin(self.angles), np.zeros(len(self.angles))])
        manoeuvres = Manoeuvres.accelerations(share * around, gravity) + self._straight(share)
        if given.slope:
            along, down = np.linalg.norm(gravity) * np.array([np.sin(given.slope), -np.cos(given.slope)])
            pulls = [[along, 0, down], [-along, 0, down], [0, along, down], [0, -along, down]]
            manoeuvres += Manoeuvres.accelerations(np.tile([-share, 0, 0], (4, 1)), np.array(pulls))
        for build in (self._turns, self._starts, self._stops, self._stop_speeds):
            manoeuvres += build(gravity, share)
        return manoeuvres

    def _turns(self, gravity: np.ndarray, share: float) -> Manoeuvres:
        """At constant speeds: nothing sets in."""
        return Manoeuvres.corners((_NONE, _NONE, _NONE), ((self.given.speed,), _NONE, (1, -1)), gravity)

    def _starts(self, gravity: np.ndarray, share: float) -> Manoeuvres:
        return Manoeuvres.corners((_NONE, _NONE, (share, -share)), (_NONE, _NONE, _NONE), gravity)

    def _stops(self, gravity: np.ndarray, share: float) -> Manoeuvres:
        """In a turn whose radius stays: the turning slows down with the speed."""
        v, w = self.given.speed, self.given.turning * np.array([1, -1])
        steady, slowing = np.zeros((2, 9)), np.zeros((2, 9))
        if share > 0:
            steady[:, 1], steady[:, 5] = v * w, w
        slowing[:, 0], slowing[:, 8] = -share, -share * w / v
        return replace(Manoeuvres.along(slowing, gravity), constant=steady)

    def _stop_speeds(self, gravity: np.ndarray, share: float) -> Manoeuvres:
        """Over the speed."""
        bend, d = np.array([1, -1]) / self._radius, share * self.stop_deceleration
        steady, linear, square = np.zeros((2, 9)), np.zeros((2, 9)), np.zeros((2, 9))
        steady[:, 0], steady[:, 8] = -d, -d * bend
        if share > 0:
            square[:, 1], linear[:, 5] = bend, bend
        return replace(Manoeuvres.along(linear, gravity), constant=steady, square=square)

    @cached_property
    def nominal(self) -> LargestManoeuvres:
        """Of the nominal model: of the directions, then of the manoeuvres."""
        return self._largest(self._all(1.0))

    @cached_property
    def within(self) -> LargestManoeuvres | None:
        """In the worst case of the uncertainty; None without one."""
        return self._worst_of(self._all, self.nominal) if self.counting.given else None

    def _worst_of(
        self, build: Callable[[float], Manoeuvres], nominal: LargestManoeuvres | None = None
    ) -> LargestManoeuvres:
        """Of manoeuvres whose accelerations set in and end at once."""
        more = self.counting.overshoot
        begun = self._largest(build(1 + more), self.counting, nominal)
        return begun.lower(self._largest(build(-more), self.counting, None, begun)) if more else begun

    def _largest(
        self, manoeuvres: Manoeuvres, tolerance: Uncertainty = NONE, *known: LargestManoeuvres | None
    ) -> LargestManoeuvres:
        """At rest, or in the states of the motion that are worst for the nominal base.

        `known`: the nominal result, and one above which nothing is searched, see `largest_manoeuvres`.
        """
        if self.motion is None:
            return largest_manoeuvres(self.robot, self.q, manoeuvres, tolerance, self.interface, *known)
        times, states = self._states
        number = worst_states(self.robot, states, manoeuvres, self.interface)
        count = number.shape[1]
        repeated = [one and one.repeated(count) for one in known]
        sample = states[number.ravel()], manoeuvres.repeated(count), tolerance, self.interface
        return largest_manoeuvres(self.robot, *sample, *repeated).at_worst(times[number])

    @cached_property
    def _states(self) -> tuple[np.ndarray, np.ndarray]:
        """Instants (N,), s, of the motion, and the states there, with a process that varies."""
        assert self.motion is not None
        times = self.motion.both_sides(_SPACING)
        acting = self.robot.during(self.motion).acting(times)
        return times, np.hstack([*self.motion.states(times), acting])

    @property
    def worst(self) -> LargestManoeuvres:
        """Within the uncertainty, or nominal without one."""
        return self.within or self.nominal

    @property
    def worst_direction(self) -> tuple[float, float]:
        """The smallest of the largest accelerations, m/s^2, and its direction, rad."""
        k = int(np.argmin(self._around))
        return float(self._around[k]), float(self.angles[k])

    @cached_property
    def _around(self) -> np.ndarray:
        """(D,) largest accelerations in the directions that base and objects allow."""
        count, every = len(self.angles), (self, *self.objects.values())
        return np.min([envelope.worst.largest[:count] for envelope in every], axis=0)

    @property
    def worst_direction_words(self) -> str:
        """The direction in words: where friction decides everywhere, none is worse than another."""
        around = self._around
        if np.max(around) - np.min(around) <= _SAME * np.max(around):
            return "in every direction"
        return f"at {np.degrees(self.worst_direction[1]):.0f} deg (0: forward, 90: left)"

    @property
    def first_lift(self) -> str:
        """Where the first contact lifts before the base tips, which may be long before; empty: nowhere."""
        count = len(self.angles)
        lift, tip = self.worst.lift[:count], self.worst.tip[:count]
        around = np.where(lift < tip * (1 - _NOISE), lift, np.inf)  # NaN: not known
        k = int(np.argmin(around))
        if np.isinf(around[k]):
            return ""
        case = "worst case" if self.within else "nominal"
        value = np.trunc(1e3 * around[k] + _NOISE) / 1e3 + 0.0
        where = f"lifts at {value:.4g} m/s^2 at {np.degrees(self.angles[k]):.0f} deg, {case}"
        springs = "with their declared stiffness" if self.robot.support.elastic else "if equally compliant"
        return f"{where}, {springs}; the base does not tip there"

    def limit(self, key: str) -> float | None:
        """The limit of a manoeuvre by base and objects, within the uncertainty; None where nothing limits."""
        k = [one.key for one in self.manoeuvres].index(key)
        every = (self, *self.objects.values())
        least = min(float(envelope.worst.largest[len(self.angles) + k]) for envelope in every)
        return self.manoeuvres[k].value(least)

    @property
    def locked_wheels_tip(self) -> bool:
        """Whether the base tips before its wheels slide when they are locked on level ground.

        It moves straight on before that; a holonomic base in any direction.
        """
        some = slice(len(self.angles)) if self.given.holonomic else [len(self.angles) + 1]
        return any(bool(np.any(one.slip[some] >= one.tip[some])) for one in (self.nominal, self.worst))

    @cached_property
    def smoother(self) -> Smoother:
        """Parameters of Nav2's velocity smoother, forward and in both directions.

        The largest share of the single limits such that every corner of them is kept, and every step from
        one corner to another.
        """
        forward, brake, speed = self._capped("accelerate"), self._capped("brake"), self.given.speed
        same = min(forward, brake)
        return Smoother(self._smoother(forward, brake, (speed,)), self._smoother(same, same, (speed, -speed)))

    @property
    def navigation(self) -> dict[str, list[float]]:
        """The parameters to set: x, y, turning."""
        return self.smoother.parameters

    def _smoother(self, forward: float, brake: float, speeds: tuple[float, ...]) -> dict[str, list[float]]:
        """The largest share of limits forward and while braking that holds at these speeds."""
        swing = 1 + 2 * self.counting.overshoot  # of a step from one end of a symmetric interval to the other
        side = min(self._capped("left"), self._capped("right")) if self.given.holonomic else 0.0
        start = min(self._capped("start_turning_left"), self._capped("start_turning_right"))
        turn, speed = min(self._capped("turn_left"), self._capped("turn_right")), self.given.speed
        sideways, step = speed if side else 0.0, self.counting.overshoot * (forward + brake)
        accelerations = (
            (forward + step, -brake - step),
            {swing * side, -swing * side},
            (swing * start, -swing * start),
        )
        velocities = speeds, {sideways, -sideways}, (turn, -turn)
        corners = Manoeuvres.corners(accelerations, velocities, self.robot.support.gravity)
        every = [
            envelope._largest(corners, self.counting).largest for envelope in (self, *self.objects.values())
        ]
        most = min(1.0, float(np.min(every)))
        return {
            "max_velocity": [speed, sideways, most * turn],
            "min_velocity": [min(0.0, *speeds), 0.0 - sideways, -most * turn],
            "max_accel": [most * forward, most * side, most * start],
            "max_decel": [-most * brake, -most * side, -most * start],
        }

    def _capped(self, key: str) -> float:
        return LARGEST if (result := self.limit(key)) is None else result

    @property
    def ground(self) -> str:
        """On which ground the parameters for navigation hold, in words."""
        level, given = "on level ground", self.given.slope
        if not given:
            return level
        slopes = ("downhill", "uphill", "across_left", "across_right")
        down = np.trunc(1e3 * min(self._capped(f"brake_{name}") for name in slopes)) / 1e3
        slope = f"a slope of {np.degrees(given):.4g} deg"
        return f"{level}; straight braking on {slope}: {down:.4g} m/s^2 at most"

    @property
    def together(self) -> str:
        """By how much the parameters for navigation are below the limits of single manoeuvres, in words."""
        alone = self._capped("accelerate")
        share = self.navigation["max_accel"][0] / alone if alone else 0.0
        return f"{100 * share:.0f} % of the limits of single manoeuvres: all hold at once, in turns as well"

    @property
    def scope(self) -> str:
        """What the envelope is about, in words."""
        within = f"within {self.tolerance.scope}" if self.counting.given else "nominal model only"
        arm = "arm at rest" if self.motion is None else "worst instants of the motion of the arm"
        return f"{arm}, {within}"

    @property
    def sharing(self) -> str:
        """How wheels share the load where they slide, in words; empty where only one is possible."""
        springs = self.robot.support.elastic
        if not springs and np.all(self.worst.alike >= LARGEST):
            return ""
        how = "as their declared stiffness says" if springs else "as equally compliant ones do"
        return f"wheels share the load {how}; ideal: where friction ends if they shared it optimally"

    @property
    def not_covered(self) -> tuple[str, ...]:
        """What the envelope leaves out, in words."""
        moving = "instants between the samples", "overshoot of the arm's acceleration steps"
        of_arm = ("motion of the arm",) if self.motion is None else moving
        steps = () if self.counting.overshoot else ("overshoot of an acceleration that sets in at once",)
        unknown = np.isnan(self.nominal.lift).any()
        share = ("how equally compliant wheels share the load",) if unknown else ()
        return (*of_arm, *NOT_COVERED, *share, *steps, *self.ignored)

    @property
    def steps(self) -> str:
        """What an acceleration that sets in at once does, in words; empty: nothing more."""
        more = self.counting.overshoot
        text = f"steps of acceleration overshoot by {100 * more:.3g} % (damping of the uncertainty)"
        return text if more else ""

    @property
    def ignored(self) -> tuple[str, ...]:
        """Deviations of the uncertainty that do not count."""
        given, counting = self.tolerance, self.counting.given
        return tuple(str(given.only(name)) for name in given.given if name not in counting)

    def __repr__(self) -> str:
        """The scope, and the worst direction."""
        where = f"{self.worst_direction[0]:.3g} m/s^2 {self.worst_direction_words}"
        return f"<DriveEnvelope {self.name}: {where}; {self.scope}>"

    def _limits(self, k: int, one: Manoeuvre) -> dict[str, Any]:
        cases = (("nominal", self.nominal), ("within", self.within))
        return {name: manoeuvre_limits(result, k, one) for name, result in cases if result is not None}

    @property
    def limits(self) -> dict[str, Any]:
        """Limits of the directions and manoeuvres, as plain data."""
        around = Manoeuvre("direction", "")
        return {
            "directions": [
                {"direction_deg": float(np.degrees(angle)), "unit": around.unit, **self._limits(k, around)}
                for k, angle in enumerate(self.angles)
            ],
            "manoeuvres": {
                one.key: {"text": one.text, "unit": one.unit, **self._limits(len(self.angles) + k, one)}
                for k, one in enumerate(self.manoeuvres)
            },
        }

    def to_dict(self) -> dict[str, Any]:
        """The content of drive.json; see docs/how-to/drive-envelope.md."""
        given, objects = self.given, {name: carried.limits for name, carried in self.objects.items()}
        return {
            "posture": self.name,
            **({"choice": self.choice} if self.choice else {}),
            "stands": self.stands,
            "broken": list(self.broken),
            "scope": self.scope,
            "sharing": self.sharing,
            "assumed": [ASSUMED, *self.robot.notes],
            "not_covered": list(self.not_covered),
            "tolerance": self.tolerance.to_dict(),
            "joints": dict(zip(self.robot.names, self.q.tolist(), strict=True)),
            "units": list(self.robot.units),
            **self.robot.masses_to_dict(),
            "speed_m_s": given.speed,
            "turning_rad_s": given.turning,
            "slope_deg": float(np.degrees(given.slope)),
            "stop_deceleration_m_s2": self.stop_deceleration,
            **self.limits,
            **({"objects": objects} if objects else {}),
            "locked_wheels_tip": self.locked_wheels_tip,
            "navigation": self.navigation,
            "versions": versions(),
        }

    def to_yaml(self) -> str:
        """Parameters of Nav2's velocity smoother."""
        edge = "the edge, if accelerations rise gently; what sets in at once overshoots"
        if self.steps:
            edge = f"the edge; {self.steps}, counted also from full acceleration to full braking"
        lift = f"first contact: {self.first_lift}" if self.first_lift else ""
        if not lift and not np.isnan(self.worst.lift[: len(self.angles)]).any():
            lift = "no contact lifts before the base tips on level ground, if contacts are equally compliant"
        first = f"{self.name}: {self.scope}"
        remarks = (
            first,
            self.together,
            self.ground,
            edge,
            ASSUMED,
            self.sharing,
            self.smoother.reverse,
            lift,
            self.choice,
        )
        return smoother_yaml(remarks, self.navigation)

    def contents(self, figures: bool) -> dict[str, bytes]:
        """drive.csv, drive.png, and nav2.yaml where the base may drive."""
        limits = {"": self.limits, **{name: envelope.limits for name, envelope in self.objects.items()}}
        rows = limits_csv(limits, ["nominal", *(["within"] if self.within else [])])
        files = {"drive.csv": rows.encode()}
        if self.stands:
            files["nav2.yaml"] = self.to_yaml().encode()
        if figures:
            feet = np.array([contact.position for contact in self.robot.support.contacts])
            objects = {name: carried.worst for name, carried in self.objects.items()}
            about = self.name, self.scope, self.angles, self.nominal, self.within
            files["drive.png"] = png(envelope_figure(*about, feet, objects))
        return files
