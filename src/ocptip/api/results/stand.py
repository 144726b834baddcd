"""The result of `ocptip.stand`: a base at rest under given loads, with forces, margins and the evidence."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ocptip import pictures
from ocptip.api.inputs.requirements import PAYLOAD, Outcome, Requirement, deviation, read_requirements
from ocptip.api.inputs.worst_scene import worst_of_scene
from ocptip.basics.errors import InputError
from ocptip.basics.text import NOISE, enumerated, percent, quantity
from ocptip.basics.write import versions, write_json
from ocptip.contact.elastic import Shared
from ocptip.contact.states import ContactState, ContactStates
from ocptip.contact.verdict import StabilityVerdict, state_remark
from ocptip.reserves.classical import ClassicalMeasures
from ocptip.reserves.equal_compliance import EqualSharing, equal_sharing, face_each_other, reported_slip
from ocptip.reserves.force_sets import ForceSets
from ocptip.reserves.friction_needed import FrictionDemand
from ocptip.reserves.slip import Redistribution, SlipReserve
from ocptip.reserves.tipping import TipOverReserve
from ocptip.standing.at_rest.slope import FloorSlope, largest_slope, tilted_wrench
from ocptip.standing.footing import Footing
from ocptip.standing.tolerance import NONE, Uncertainty
from ocptip.task_files.scene import Scene

if TYPE_CHECKING:
    from ocptip.api.inputs.postures import LargestPayload, PossibleProcess, RestingPosture
    from ocptip.standing.at_rest.sensitivity import Sensitivity
    from ocptip.standing.within.design import Design
    from ocptip.standing.within.rest import WithinAtRest

NO_MARGIN = 1 - 1e-9  # GN and GT from here on are 1 but for rounding
_DOUBLINGS = 12  # of a required deviation, until a contact is lost
_MOST = {"tilt": 45.0, "friction loss": 99.9}  # what an uncertainty may have, deg and %


@dataclass(frozen=True, eq=False, repr=False)
class Standing:
    """The result for a base at rest under given loads.

    Attributes:
        scene: the base on its contacts, and the loads.
        states: a batch of one: the contact solver's answer; where that moves although a solution on the
            true cones stands, that one.
        tip, slip: the margins against tipping and slipping of that state.
        redistribution: of the slip margin: "tangential", or "full" where normal forces are not unique.
        verdict: whether every solution of the contact laws stands.
        reference_given: the reference moment of GN is the user's, not the support's.
        within: the worst of the uncertainty; None: none was given.
        sensitivities: what changes would do; empty if not asked for.
        tolerance: the uncertainty that was asked for.
        posture: of the robot whose scene this is; None: the scene is no robot's.
        objects: the same of each object that the robot carries, in axes of the gripper or the base.
    """

    scene: Scene
    states: ContactStates
    tip: TipOverReserve
    slip: SlipReserve
    redistribution: Redistribution
    verdict: StabilityVerdict
    reference_given: bool = False
    within: WithinAtRest | None = None
    sensitivities: Sequence[Sensitivity] = ()
    tolerance: Uncertainty = NONE
    posture: RestingPosture | None = None
    objects: tuple[Standing, ...] = ()

    def __repr__(self) -> str:
        """The verdict with the margins and their units."""
        axis, moment = self.nearest_axis, ""
        if axis:
            numbers = " and ".join(str(k) for k in sorted(set(axis["contacts"])))
            moment = f"tipping margin {quantity(axis['moment_reserve'], 'N m', 3)} about contacts {numbers}, "
        force = quantity(float(np.min(self.normal_forces)), "N", 3)
        verdict = "stable" if self.stable else "not stable"
        used = f"friction used {percent(float(self.slip.slip_ratio[0]))}, minimum normal force {force}"
        return f"<Standing {self.scene.name}: {verdict} ({self.verdict.verdict}), {moment}{used}>"

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write the data as JSON, or a picture (.png, .pdf, .svg), into a file; returns its path."""
        if (path := Path(path)).suffix == ".json":
            write_json(path, self.to_dict())
        else:
            slip, below = reported_slip(self.states, self.slip), "; ".join(self._not_in_state)
            pictures.scene.plot_scene(self.scene, self.states, self.tip, slip, path, below=below)
        return path

    @property
    def _not_in_state(self) -> Iterator[str]:
        """What is not stable although the state that is drawn is."""
        known = self.within if self.nominally_stable else None
        if self.states.persistent[0] and not self.stable:
            yield f"NOT STABLE {f'within {known.scope}' if known else 'in every solution'}"
        if self.posture and self.posture.refusals:
            yield "the arm cannot rest there"

    def require(self, text: str) -> tuple[Outcome, ...]:
        """Return which requirements the base meets.

        Example::

            found.require("tilt >= 5 deg, tipping margin >= 20 N m")

        Each deviation is checked alone. Margins are those of the worst case where there is an uncertainty.

        Args:
            text: requirements with commas between them; `ocptip.api.inputs.requirements.UNITS` names the
                quantities.

        Raises:
            InputError: one of them cannot be understood, or is not of a base at rest.
        """
        return tuple(map(self._outcome, read_requirements(text)))

    def _outcome(self, wanted: Requirement) -> Outcome:
        if self.posture is not None:
            self.posture.robot.require_no_objects("require")
        note = "worst case" if self.within else "nominal"
        if wanted.name == "tipping margin":
            reference = self.tip.tip_over.reference_moment
            if self.within and reference:
                return wanted.compared(self.within.tipping_margin(reference), note=note)
            axis = self.nearest_axis
            return wanted.compared(axis["moment_reserve"] if axis else np.inf, note=note)
        if wanted.name == "friction used":
            note += ", shared optimally" if self.redistribution == "full" else ""
            GT = self.within.GT if self.within else float(self.slip.GT[0])
            return wanted.compared(100 * GT, note=note)
        if wanted.name == "foot force":
            return wanted.compared(float(np.nanmin(self.normal_reserves)), note="nominal")
        if not self.nominally_stable:
            return wanted.compared(0.0, note="not stable without any deviation")
        note, slope = "alone, else nominal", self.largest_slope if wanted.name == "tilt" else None
        if slope is not None:
            angle = float(np.degrees(slope.angle))
            return wanted.compared(angle, at_least=not slope.loss, note=note)
        value, at_least = self._largest(wanted)
        if wanted.name == PAYLOAD and self.posture and (held := self.posture.held_by_drives) < value:
            return wanted.compared(held, note="beyond what is held, nominal; the drives hold no more")
        return wanted.compared(value, at_least=at_least, note=note)

    def _largest(self, wanted: Requirement) -> tuple[float, bool]:
        """The largest deviation that loses no contact, and whether it is only at least that.

        Raises:
            InputError: it is none of a base without an arm.
        """
        value = kept = wanted.bound or 1.0
        for _ in range(_DOUBLINGS):
            uncertainty, within = deviation(replace(wanted, bound=value)), None
            if self.posture is not None:
                within = self.posture.within(uncertainty)
            elif wanted.name not in (PAYLOAD, "push"):
                within = worst_of_scene(self.scene, uncertainty)
            if within is None or within.ignored:
                raise InputError(f"require: {wanted.name}: needs an arm; give its task file with --posture")
            if not within.stands:
                return within.possible * value, False
            kept, value = value, max(value, min(2 * value, _MOST.get(wanted.name, np.inf)))
            if value == kept:
                break
        return kept, True

    @property
    def state(self) -> ContactState:
        """The one state."""
        return self.states[0]

    @cached_property
    def equal(self) -> EqualSharing | None:
        """The forces of equally compliant feet; None where the forces are unique or the base moves."""
        equal = equal_sharing(self.states)
        return equal if equal and np.isfinite(equal.GT[0]) else None

    @cached_property
    def classical(self) -> ClassicalMeasures | None:
        """Classical measures, to compare; None unless ordinary contacts lie on one plane."""
        if self.scene.planar or not self.tip.tip_over.on_polygon:
            return None
        forces = self.normal_forces[None]
        resting = self.posture
        centers = resting.robot.center_of_mass(resting.q[None]) if resting else None
        return ClassicalMeasures.under(self.scene.wrench[None], self.tip.tip_over, forces, centers)[0]

    @cached_property
    def friction_demand(self) -> FrictionDemand | None:
        """The friction that holds the base, and the force that is missing; None where it is not known."""
        if self.scene.planar or not self.state.solved:
            return None
        demand = FrictionDemand.of(self.scene.support, self.scene.wrench)
        return None if np.isnan(demand.factor) else demand

    @property
    def normal_forces(self) -> np.ndarray:
        """(n,) N: of equally compliant feet, where rigid ones leave them open."""
        return (self.equal or self.slip).normal_forces[0]

    @property
    def friction_used(self) -> np.ndarray:
        """(n,) shares of the friction, with these normal forces."""
        return (self.equal or self.slip).usage[0]

    @property
    def normal_reserves(self) -> np.ndarray:
        """(n,) distance of the normal forces from the ends of their sets, N."""
        return np.minimum(*ForceSets(self.scene.support).distances(self.normal_forces))

    @cached_property
    def feet(self) -> Shared | None:
        """The forces of compliant feet; None for rigid ones, or where the base does not rest."""
        elastic = self.scene.support.elastic
        shared = elastic.share(self.states.wrenches) if elastic and self.state.persistent else None
        return shared if shared and shared.balanced[0] else None

    @property
    def stable(self) -> bool:
        """True if base and objects are stable, also within the uncertainty where there is one."""
        return self.stable_itself and all(carried.stable_itself for carried in self.objects)

    @property
    def stable_itself(self) -> bool:
        """The same, whatever becomes of objects on it."""
        return self.nominally_stable and (self.within is None or self.within.stands)

    @property
    def critical(self) -> Standing:
        """The one of base and objects that is nearest to the loss of a contact.

        In the worst case where all have one, else in the nominal model.
        """
        every = (self, *self.objects)
        if all(footing.within for footing in every):
            return max(
                every,
                key=lambda footing: max(footing.within.GN, footing.within.GT) if footing.within else 0.0,
            )
        return max(every, key=lambda footing: max(footing.tip.GN[0], footing.slip.GT[0]))

    @property
    def nominally_stable(self) -> bool:
        """True if the nominal base stands: all solutions of the contact laws do, as far as is known.

        With ordinary contacts this does not depend on the facets of the friction pyramids. Where rigid
        contacts leave it open, declared springs decide.
        """
        undecided = self.verdict.weak and not self.verdict.decided
        undecided &= self.verdict.state.persistent
        return self.state.solved and (self.verdict.strong or undecided or self.on_springs)

    @property
    def on_springs(self) -> bool:
        """Whether the forces of declared springs hold the base, within the friction."""
        return bool(self.feet and self.slip.GT[0] < NO_MARGIN and not face_each_other(self.scene.support))

    @cached_property
    def largest_slope(self) -> FloorSlope | None:
        """The largest slope of the floor that loses no contact, from the nominal one on.

        None where one is lost already, of planar scenes, without gravity, on a base that drives, and of
        mechanisms that are no arm.
        """
        support, gravity, posture = self.scene.support, self.scene.support.gravity, self.posture
        if self.scene.planar or not gravity.any() or not self.nominally_stable:
            return None
        if posture is not None:
            return posture.largest_slope
        footing = Footing(support, self.tip.tip_over.reference_moment, self.redistribution)
        return largest_slope(footing, gravity, tilted_wrench(support, self.scene.loads))

    @cached_property
    def smallest_design(self) -> Design | None:
        """The narrowest feet and the lightest base that lose no contact within the uncertainty.

        None of planar scenes, without gravity, and of mechanisms that are no arm.
        """
        support, tolerance = self.scene.support, self.tolerance
        if self.scene.planar or not support.gravity.any():
            return None
        if self.posture is not None:
            return self.posture.design(tolerance)
        from ocptip.standing.within.design import scene_design

        return scene_design(support, self.scene.loads, tolerance)

    @cached_property
    def possible_process(self) -> PossibleProcess | None:
        """How much of the process loses no contact in this posture; None as `RestingPosture` has it."""
        return None if self.posture is None else self.posture.possible_process(self.tolerance)

    @cached_property
    def largest_payload(self) -> LargestPayload | None:
        """The largest payload in this posture within the uncertainty; None as `RestingPosture` has it."""
        return None if self.posture is None else self.posture.largest_payload(self.tolerance)

    @property
    def unsure_cause(self) -> str:
        """Why a solution of the contact laws moves, and what decides; empty unless both kinds are known."""
        moving = self.verdict.counterexample
        if moving is None:
            return ""
        pressing = moving.contact_forces[:, 0] > NOISE * np.max(np.abs(moving.contact_forces))
        rough = np.array([getattr(c, "friction", 1.0) > 0 for c in self.scene.support.contacts])
        rolls = bool(pressing.any()) and not np.any(pressing & rough)
        why = "How rigid contacts share the load is open. "
        if rolls:
            who, others = (_contact_names(np.flatnonzero(indices) + 1) for indices in (~rough, rough))
            why = f"{who} have no friction and may carry all load; then {others.lower()} hold nothing. {why}"
        return f"{why}`stiffness` of every contact decides."

    @property
    def equal_remark(self) -> str:
        """The failure that only equally compliant feet show: lift-off or too little friction; else empty."""
        if self.equal is None:
            return ""
        lifted = np.flatnonzero(self.equal.lifts[0]) + 1
        results = [f"{_contact_names(lifted).lower()} lift{'s' * (len(lifted) < 2)}"] * bool(lifted.size)
        if not self.equal.stands[0]:
            # About a single wheel left the base turns, however little of its friction it uses.
            used = np.nan_to_num(self.equal.usage[0])
            most = f" (contact {np.argmax(used) + 1} would need {percent(np.max(used))} of it)"
            results += [f"the friction is not enough{most if np.max(used) >= 1 else ''}"]
        return f"with equally compliant feet {' and '.join(results)}" if results else ""

    @property
    def without_reserve(self) -> str:
        """The failure of a base without any margin, under any further load: "tips" or "slips"; else empty."""
        if not self.nominally_stable:
            return ""
        if self.tip.GN[0] >= NO_MARGIN:
            return "tips"
        return "slips" if self.slip.GT[0] >= NO_MARGIN else ""

    @property
    def remark(self) -> str:
        """Why the solver's state does not look like the verdict; else empty."""
        return state_remark(self.verdict, float(np.nanmax(np.append(self.slip.usage[0], 0.0))))

    def to_dict(self) -> dict[str, Any]:
        """Everything; contacts in the order of the file."""
        state, demand, edges = self.state, self.friction_demand, self.tip.tip_over.edges
        changes = [one.to_dict() for one in self.sensitivities]
        axis, counterexample = self.nearest_axis, self.verdict.counterexample
        return {
            "scene": self.scene.name,
            "persistent": self.nominally_stable,
            **({"within": self.within.to_dict()} if self.within else {}),
            "without_reserve": self.without_reserve or None,
            "solved": state.solved,
            "status": state.status,
            "stability": self.verdict.verdict,
            "stability_explanation": self.verdict.explanation,
            "stability_cause": self.unsure_cause or None,
            "stability_decided": self.verdict.decided,
            "counterexample": None if counterexample is None else counterexample.modes,
            "kinds": [contact.kind for contact in self.scene.support.contacts],
            "modes": state.modes,
            "forces": state.forces,
            "redistribution": self.redistribution,
            "normal_forces": self.normal_forces,
            "friction_used": self.friction_used,
            "equal_compliance": self.equal
            and {
                "GT": self.equal.GT[0],
                "stands": bool(self.equal.stands[0]),
                "lifts": np.flatnonzero(self.equal.lifts[0]) + 1,
                "remark": self.equal_remark or None,
            },
            "best_sharing": self.equal
            and {"normal_forces": self.slip.normal_forces[0], "friction_used": self.slip.usage[0]},
            "remark": self.remark or None,
            "normal_reserves": self.normal_reserves,
            "foot_motions": self.feet.deflections[0] if self.feet else None,
            "acceleration": state.acceleration,
            "GN": self.tip.GN[0],
            "GT": self.slip.GT[0],
            "tip_ratio": self.tip.tip_ratio[0],
            "lift_acceleration_m_s2": self.tip.lift_acceleration[0],
            "slip_ratio": self.slip.slip_ratio[0],
            "slide_acceleration_m_s2": self.slip.slide_acceleration[0],
            "friction_needed": demand.factor if demand and np.isfinite(demand.factor) else None,
            "friction_missing_N": demand and demand.missing,
            "tipping_axis": axis,
            **({"classical": {**self.classical.to_dict(), "edges": edges}} if self.classical else {}),
            "largest_slope": self.largest_slope and self.largest_slope.to_dict(),
            "largest_payload": self.largest_payload and vars(self.largest_payload),
            "process_share": self.possible_process and vars(self.possible_process),
            "wrench": self.scene.wrench,
            **({"sensitivities": changes} if changes else {}),
            **({"posture": self.posture.to_dict()} if self.posture else {}),
            "assumed": self.posture.robot.notes if self.posture else [],
            **self._objects_to_dict(),
            "residual": self.verdict.state.residual,
            "pivots": self.verdict.state.pivots,
            "versions": versions(),
        }

    def _objects_to_dict(self) -> dict[str, Any]:
        """Each object by name, and what of all is critical; nothing without objects."""
        if not self.objects:
            return {}
        objects = {
            carried.scene.name: {
                "stable": carried.stable_itself,
                "stability": carried.verdict.verdict,
                **({"within": carried.within.to_dict()} if carried.within else {}),
                "GN": carried.tip.GN[0],
                "GT": carried.slip.GT[0],
                "tipping_axis": carried.nearest_axis,
                "modes": carried.state.modes,
                "normal_forces": carried.normal_forces,
                "friction_used": carried.friction_used,
                "wrench": carried.scene.wrench,
            }
            for carried in self.objects
        }
        critical = "base" if self.critical is self else self.critical.scene.name
        return {"stable": self.stable, "objects": objects, "critical": critical}

    @property
    def nearest_axis(self) -> dict[str, Any] | None:
        """The tipping axis with the minimum moment margin, N m; contacts from 1; None without one.

        Where the base tips the margin is negative: so much is missing.
        """
        index, axes = int(self.tip.nearest_axis[0]), self.tip.tip_over.axes
        if index >= 0:
            index = int(np.argmin(self.tip.margins[0]))
        if not 0 <= index < len(axes):
            return None
        axis = axes[index]
        return {
            "contacts": [k + 1 for k in axis.contacts],
            "point": axis.point,
            "direction": axis.direction,
            "moment_reserve": self.tip.margins[0, index],
        }


def _contact_names(numbers: np.ndarray) -> str:
    """The contacts: "Contact 3", "Contacts 1, 2 and 4"."""
    return f"Contact{'s' * (len(numbers) > 1)} {enumerated([*map(str, numbers)])}"
