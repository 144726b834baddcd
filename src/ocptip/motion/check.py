"""Check after the plan: does a motion keep all limits at every instant, not only at quadrature nodes?

The exact motion is sampled in every interval between switching times, up to 0.15 us from each on either side.
Torques and margins have steps there; joints that switch together do so within 0.1 us. The grid is refined
around the worst instants until these no longer move. The rest before and after the motion is also checked.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ocptip.basics.errors import InputError, positive_number
from ocptip.basics.text import some
from ocptip.motion.proof import Proof
from ocptip.motion.sampled_limits import (
    MIN_POINTS,
    IntervalValues,
    evaluate_limits,
    instants_of,
    refinements,
    worse_contacts,
)
from ocptip.motion.violations import stated, statement
from ocptip.numerics.threads import one_thread
from ocptip.standing.contact_margins import ContactMargins
from ocptip.standing.elastic.drives import DriveMotion, on_its_drives
from ocptip.standing.elastic.feet import FeetMotion, on_its_feet
from ocptip.standing.further_limits import POINT_SPEED, TCP_SPEED
from ocptip.standing.limit_kinds.kinds import limits_of
from ocptip.standing.limit_kinds.limit import SAMPLED, AskedLimit, Sampled, Worst
from ocptip.standing.limits import Limits
from ocptip.standing.mechanism import StandingMechanism
from ocptip.standing.within.in_motion import WithinTolerance, worst_of_sampled
from ocptip.trajectories.pieces import MERGE
from ocptip.trajectories.trajectory import INSIDE, Trajectory

MOST_INSTANTS = 1_000_000
"""Largest number of instants of the first grid: some 3 GB of memory."""

_ALONG = 8  # instants at which a distance is compared with the smallest one
NO_COLLISION = " (contacts and drives; collision not checked)"
"""Follows verdicts of mechanisms without collision geometry."""

NO_FLOOR = " (no floor: what reaches below the contacts is not checked)"
"""Follows verdicts where no floor is an obstacle."""

NO_PAYLOAD = " (collisions of the payload not checked: it has no [payload.shape])"
"""Follows verdicts where what the gripper holds has no solid."""

OF_PATH = ("clearance_m", "angle_margin_deg", "position_margin_m")
"""Worst values that no timing of a path changes."""

_OF_STOPS = ("_stop", "_brakes", "_cancel", "_cancel_worst_case")

_UNTIL_1 = ("GN", "GT")
_ROUNDS = 8


def of_stops(result: str) -> bool:
    """Whether a worst value of this name is one in stops, of the base or of an object."""
    return result.partition("[")[0].endswith(_OF_STOPS)


def scope_of(collision: dict[str, Any]) -> str:
    """The scope of a collision check (`Collisions.to_dict`): what was left out, in words after a verdict."""
    if not collision["checked"]:
        return NO_COLLISION
    return NO_FLOOR * (not collision["floor"]) + NO_PAYLOAD * collision["payload_unseen"]


def floor_text(collision: dict[str, Any]) -> str:
    """Which floors were obstacles in a check of collisions (`Collisions.to_dict`), in words."""
    if not collision["floor"]:
        return "no floor"
    planes = []
    for plane in collision["floor"]:
        normal = np.round(plane["normal"], 3) + 0.0
        level = f"{plane['level_m'] + 0.0:.3f} m"
        upright = np.array_equal(normal, [0, 0, 1])
        across = "at z =" if upright else f"across ({', '.join(f'{x:g}' for x in normal)}) at"
        planes.append(f"{plane['name']} {across} {level}")
    return ", ".join(planes)


def broken_in_stops(headline: str) -> str:
    """The verdict where stops of a motion break limits that the motion itself, with this headline, keeps."""
    return f"LIMITS BROKEN in stops; the motion itself is {headline}"


@dataclass(frozen=True)
class MotionCheck:
    """Outcome of the check of a motion.

    Attributes:
        verified: True only if every limit holds at every sampled instant and all contact states are solved.
        energy: J, electric.
        duration: s.
        worst: by name: GN, GT, torque_ratio, clearance_m, and the exact speed_ratio, acceleration_ratio,
            angle_margin_deg of the motion (position_margin_m of coordinates that are lengths); the
            mechanism's further limits by their names.
        violations: the broken limits, empty if verified.
        samples: number of instants evaluated.
        stands: no contact is lost at any sampled instant, whatever other limits are broken.
        feet: how the base swings on compliant feet; None where it does not, or where that is not known.
        drives: how gripper and base vibrate with elastic joints; None where they do not.
        contacts: how close contacts come to being lost, in N, N m and m, at the sampled instants.
        objects: the same of each object's contacts, by name.
        collision: what was checked, and the smallest distance, see `Collisions.to_dict`.
        within: the contacts in the worst case of the uncertainty; None without uncertainty.
        certificate: what is proved for all instants; None where nobody has put one there.
        proof_out_of_time: there is no certificate because a time limit ended the proof.
    """

    verified: bool
    energy: float
    duration: float
    worst: dict[str, Worst]
    violations: tuple[Worst, ...]
    samples: int
    stands: bool
    contacts: ContactMargins
    collision: dict[str, Any]
    objects: Mapping[str, ContactMargins] = field(default_factory=dict)
    within: WithinTolerance | None = None
    feet: FeetMotion | None = None
    drives: DriveMotion | None = None
    certificate: Proof | None = None
    proof_out_of_time: bool = False

    @property
    def certified(self) -> bool:
        """Every limit is proved to hold at every instant."""
        return self.verified and self.certificate is not None and self.certificate.certified

    @property
    def kept_while_moving(self) -> bool:
        """All limits of the motion hold, whatever becomes of it in stops."""
        return all(of_stops(broken.name) for broken in self.violations)

    @property
    def timed_well(self) -> bool:
        """Nothing is broken but limits of the path itself, which no timing changes."""
        broken = [name for name in OF_PATH if name in self.worst and self.worst[name].broken]
        return len(broken) == len(self.violations)

    @property
    def slowing(self) -> float:
        """The factor of all times that would cure what is broken if it were due to accelerations alone."""
        ratios = [
            1 + worst.excess / worst.limit
            for name, worst in self.worst.items()
            if worst.broken and worst.limit > 0 and name not in OF_PATH
        ]
        return max(ratios, default=1.0) ** 0.5

    def not_proved(self, asked: Iterable[AskedLimit]) -> list[tuple[AskedLimit, float, list[float]]]:
        """Limits that the certificate leaves open, by how much, and when, s."""
        results = []
        for limit in asked if self.certificate is not None else ():
            assert self.certificate is not None
            key = limit.robot.interfaces[limit.interface].result(limit.setting)
            short, times = self.certificate.short_of(limit.name, key, limit.number)
            if short > 0:
                results.append((limit, short, times or [self.worst[limit.result].time]))
        return results

    @property
    def proved_while_moving(self) -> bool:
        """The motion is proved to keep its limits; stops are beyond the proof."""
        proof = self.certificate if self.kept_while_moving else None
        return proof is not None and proof.holds and all(map(of_stops, proof.sampled))

    @property
    def lacks_cancels(self) -> bool:
        """The motion is proved, but not that cancels lose no contact, though the samples keep that."""
        proof = self.certificate if self.verified and self.proved_while_moving else None
        return proof is not None and proof.lacks_cancels

    @property
    def unproved(self) -> str:
        """What a proof lacks, where, and what helps; empty if everything is proved or a limit is broken."""
        if not self.kept_while_moving or self.proved_while_moving:
            return ""
        if self.certificate:
            return self.certificate.missing
        why = "the time was up before it was complete" if self.proof_out_of_time else "none was tried"
        return f"a proof: {why}, ocptip certify tries it"

    @property
    def headline(self) -> str:
        """The verdict in capital letters, and what it is about; stops have a separate part."""
        if not self.kept_while_moving:
            if not self.stands:
                return "NOT STABLE"
            about = f" for {self.within.tolerance.scope}" if self.within else ""
            return f"LIMITS BROKEN{about}{self._if_equally_compliant}{self.scope}"
        about = "for the nominal model only (no uncertainty)" if self.within is None else ""
        word = f"PROVED {about}" if self.proved_while_moving else f"CHECKED at samples {about}"
        if self.within is not None:
            word += f"for {self.within.tolerance.scope}"
        word += self._if_equally_compliant + self._nominal_speeds + self.scope
        return word if self.verified else broken_in_stops(word)

    @property
    def _if_equally_compliant(self) -> str:
        """Where equally compliant feet lose what another sharing of the load keeps; else empty."""
        differs, alike = self.contacts.differs, self.within and self.within.alike
        if not differs and alike and alike.value < 0:
            differs = f"with equally compliant feet {alike.where} may lift within the uncertainty"
        friction = self.within and self.within.alike_friction
        if not differs and friction and friction.value >= 1:
            differs = "equally compliant feet may slip within the uncertainty"
        return f", BUT {differs}" if differs else ""

    @property
    def _nominal_speeds(self) -> str:
        """Where speeds of points keep their limits with joints on time, but delays are not covered."""
        limited = self.within and any(name in self.worst for name in (TCP_SPEED, POINT_SPEED))
        covered = self.certificate is not None and self.certificate.speeds_within
        return ", speeds of points in the nominal model" if limited and not covered else ""

    @property
    def scope(self) -> str:
        """The scope of a verdict, in words that follow it; empty where nothing was left out."""
        return scope_of(self.collision)

    @property
    def feet_lines(self) -> list[str]:
        """The vibration of the base on compliant feet, in words; empty where they are rigid."""
        return self.feet.lines() if self.feet else []

    @property
    def drive_lines(self) -> list[str]:
        """The vibration of gripper and base with elastic joints, in words; empty where joints are rigid."""
        return self.drives.lines(self.contacts) if self.drives else []

    @property
    def collision_text(self) -> str:
        """The checked collisions and the smallest distance, in words."""
        data = self.collision
        if not data["checked"]:
            return "not checked: no collision geometry"
        least = data["least"]
        gap = f"{1e3 * least['distance_m']:.1f} mm between {' and '.join(least['between'])}"
        unseen = [" and ".join(pair) for pair in data["unseen"]]
        more = f"; not seen, for their solids mostly overlap: {some(unseen, 3)}" if unseen else ""
        return f"{data['pairs']} pairs ({data['source']}), minimum {gap}; {floor_text(data)}{more}"

    def objects_to_dict(self) -> dict[str, Any]:
        """Plain data for JSON: `objects` with the contacts of each; nothing without any."""
        return (
            {"objects": {name: carried.to_dict() for name, carried in self.objects.items()}}
            if self.objects
            else {}
        )

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        return {
            "verified": self.verified,
            "energy_J": self.energy,
            "duration_s": self.duration,
            "worst": {name: worst.to_dict() for name, worst in self.worst.items()},
            "violations": stated(self.violations),
            "samples": self.samples,
            "stands": self.stands,
            "contacts": self.contacts.to_dict(),
            **self.objects_to_dict(),
            "feet": self.feet.to_dict() if self.feet else None,
            **({"drives": self.drives.to_dict()} if self.drives else {}),
            "collision": self.collision,
            **({"within_tolerance": self.within.to_dict()} if self.within else {}),
            "certified": self.certified,
            "certificate": self.certificate.to_dict() if self.certificate else None,
        }


Prove = Callable[[StandingMechanism, Trajectory, MotionCheck, Limits], MotionCheck]
"""Gives a verified check its `Proof`; pickled with tasks, so that workers can call it."""


@one_thread
def check_motion(
    robot: StandingMechanism,
    motion: Trajectory,
    limits: Limits | None = None,
    *,
    step: float = 0.01,
    progress: Callable[[int, int, None], None] | None = None,
) -> MotionCheck:
    """Check a motion against all limits on a dense grid that is refined around the worst instants.

    Args:
        robot: the arm on its support.
        motion: exact, by velocity profiles, or samples: then the check is of the curve through them.
        limits: default 0.9 for GN and GT, the arm's torques, no collision.
        step: first spacing of the grid inside the intervals between switching times, s.
        progress: called with the numbers of instants that are checked and that are to be checked.

    Raises:
        InputError: the motion does not fit the arm, step is not positive, or so small that the grid would
            have more than `MOST_INSTANTS`.
    """
    step = positive_number("step", step)
    robot.require_fit(motion.n)
    described, robot = robot, robot.during(motion)
    pieces, end = robot.acts.pieces(motion), max(motion.end, robot.acts.end)
    if end > motion.end:  # the base drives on when the arm has come to rest
        knots = robot.acts.knots
        edges = np.array([motion.end, *knots[(knots > motion.end + MERGE) & (knots < end)], end])
        pieces = np.vstack([pieces, np.column_stack([edges[:-1], edges[1:]])])
    instants = end / step + MIN_POINTS * len(pieces)
    if not instants <= MOST_INSTANTS:
        raise InputError(
            f"step: the motion lasts {end:.4g} s, which would be {instants:.2g} instants at steps of "
            f"{step:.4g} s, more than {MOST_INSTANTS:.0e}; take larger steps, or correct a speed or an "
            "acceleration that is far too small"
        )
    limits = limits or Limits()
    kinds = limits_of(robot, limits)
    grids = [IntervalValues(left + INSIDE, right - INSIDE, step) for left, right in pieces]
    grids += [IntervalValues(t, t, step) for t in (-INSIDE, end + INSIDE)]
    samples, unsolved, uncertified, lost = 0, [], [], dict[str, None]()
    contacts = tuple[ContactMargins, ...]()
    todo, ends = [grid.times for grid in grids], np.empty(0, dtype=int)
    for _ in range(_ROUNDS):
        count = sum(map(len, todo))
        if count == 0:
            break
        if progress is not None:
            progress(samples, samples + count, None)
        samples += count
        grid_values = evaluate_limits(robot, motion, kinds, todo, limits.GT)
        unsolved += grid_values.unsolved
        uncertified += grid_values.uncertified
        lost |= dict.fromkeys(grid_values.lost)
        # The grid is refined for the limits that are asked for; what is counted must not depend on them.
        further = tuple(item.uncounted for item in grid_values.contacts) if contacts else grid_values.contacts
        contacts, ends = worse_contacts(contacts, further) if contacts else further, grid_values.ends
        for grid, times, values in zip(grids, todo, grid_values.split(todo), strict=True):
            if len(times):
                grid.add(times, values)
        todo = refinements(grids)
    names = [item.name for item in robot.interfaces]
    times = np.concatenate([grid.times for grid in grids])
    values = np.concatenate([grid.values for grid in grids])
    holding, worst = not (lost or unsolved), list[Worst]()
    sampled = Sampled(described, motion, times, lambda time: instants_of(robot, motion, np.array([time])))
    rows = zip(kinds, np.split(values, ends, axis=1), strict=True)
    for limit, item in sorted(rows, key=lambda row: row[0].scenario):
        of_limit = limit.worst(item, sampled)
        if limit.scenario == SAMPLED and limit.of_contacts and limit.of_motion:
            # These indices reach 1 where a contact is lost; other limits of contacts are forces and lifts.
            holding &= all(
                w.value < 1 if w.name.partition("[")[0] in _UNTIL_1 else not w.broken for w in of_limit
            )
        worst += of_limit
    within = worst_of_sampled(sampled, limits.tolerance) if limits.tolerance.given else None
    violations = [w for w in worst if w.broken]
    statements = []
    if unsolved:
        statements.append(
            f"no verified contact state at {len(unsolved)} instants, first at {unsolved[0]:.4f} s"
        )
    if uncertified:
        statements.append(
            f"the slip optimum is not proved at {len(uncertified)} instants, first at "
            f"{uncertified[0]:.4f} s: GT there is an upper bound, beyond the limit"
        )
    for name in lost:
        of = "" if name == names[0] else f" of {name}"
        statements.append(f"a contact{of} slips or lifts off")
    violations += map(statement, statements)
    return MotionCheck(
        verified=not violations,
        energy=robot.energy(motion),
        duration=motion.end,
        worst={w.name: w for w in worst},
        violations=tuple(violations),
        samples=samples,
        stands=holding,
        contacts=contacts[0],  # rest is checked, too
        objects=dict(zip(names[1:], contacts[1:], strict=True)),
        collision=robot.collision.to_dict(*_nearest(motion, worst)),
        within=within,
        feet=on_its_feet(robot, motion),
        drives=on_its_drives(robot, motion),
    )


def _nearest(motion: Trajectory, worst: list[Worst]) -> tuple[np.ndarray, np.ndarray]:
    """Coordinates (n,) at the smallest distance, and (N, n) all along the motion."""
    times = [w.time for w in worst if w.name == "clearance_m"]
    along = np.linspace(0.0, motion.end, _ALONG)
    return motion.states(np.array(times))[0][0], motion.states(along)[0]
