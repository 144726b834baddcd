"""`ocptip stand`: everything about one scene."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ocptip.basics.errors import InputError, naming
from ocptip.basics.text import percent, quantity, ratio, without_noise
from ocptip.basics.write import versions
from ocptip.cli.command import Report
from ocptip.cli.layout import named, sensitivities_to_dict, table, under
from ocptip.cli.terminal import say_if_compiling
from ocptip.contact.elastic import Shared
from ocptip.contact.moving import what_moves
from ocptip.contact.states import BEYOND_RESOLUTION, STATUS, ContactState, ContactStates
from ocptip.contact.verdict import StabilityVerdict, stability, standing_state, state_remark
from ocptip.numerics.compiled import interpreted
from ocptip.reserves.equal_compliance import EqualSharing, equal_sharing, face_each_other, reported_slip
from ocptip.reserves.force_sets import ForceSets
from ocptip.reserves.friction_needed import friction_needed, needed_text
from ocptip.reserves.slip import Redistribution, Slip, SlipReserve
from ocptip.reserves.tipping import TipOver, TipOverReserve
from ocptip.task_files.scene import Scene, read_scene
from ocptip.task_files.tolerance import load_tolerance

if TYPE_CHECKING:
    from ocptip.cli.stand_posture import RestingPosture
    from ocptip.standing.sensitivity import Sensitivity
    from ocptip.standing.tolerance import Tolerance
    from ocptip.standing.within.rest import WithinAtRest

PLOT_FORMATS = (".png", ".pdf", ".svg")
FEW = 8  # contacts: one state is solved sooner than machine code is loaded
_NO_RESERVE = 1 - 1e-9  # reserve values from here on are 1 but for rounding


def run(options: Namespace) -> StandReport:
    """Solve the scene; evaluate its reserves and its stability."""
    if options.plot is not None:
        check_plot_target(options.plot)
    posture = None
    if options.posture is None:
        scene = read_scene(options.scene)
    else:
        from ocptip.cli.stand_posture import read_posture  # loads for 0.3 s what scenes do not need

        posture = read_posture(options)
        scene = posture.scene
    tolerance = scene.tolerance
    if options.tolerance is not None:
        with naming("--tolerance"):
            tolerance = load_tolerance(options.tolerance)
    if tolerance.given or options.sensitivities or len(scene.support.contacts) > FEW:
        say_if_compiling()
        return _solved(scene, posture, tolerance, options)
    with interpreted():
        return _solved(scene, posture, tolerance, options)


def _solved(
    scene: Scene, posture: RestingPosture | None, tolerance: Tolerance, options: Namespace
) -> StandReport:
    support, reference = scene.support, options.gn_reference
    slip = Slip(support)
    within, sensitivities = None, ()
    if posture is not None:
        within = posture.within(tolerance)
    elif tolerance.given:
        from ocptip.standing.within.rest import scene_within

        with naming(scene.name):
            within = scene_within(support, scene.loads, tolerance, reference)
    verdict = stability(support, scene.wrench)
    state = verdict.state
    if verdict.weak and state.solved and not state.persistent:
        state = standing_state(verdict) or state
    states = state.states
    try:
        tip_over = TipOver(support, reference) if posture is None else posture.robot.tip_over
    except InputError as error:
        raise InputError(str(error).replace("reference_moment", "--gn-reference")) from None
    if options.sensitivities:
        from ocptip.standing.sensitivity import scene_sensitivities

        sensitivities = scene_sensitivities(support, scene.loads, reference)
    return StandReport(
        scene=scene,
        states=states,
        tip=tip_over.evaluate(states),
        slip=slip.evaluate(states, derivatives=False),
        redistribution=slip.redistribution,
        verdict=verdict,
        reference_given=reference is not None,
        plot=options.plot,
        within=within,
        sensitivities=sensitivities,
        posture=posture,
    )


@dataclass
class StandReport(Report):
    """What `ocptip stand` knows about a scene.

    Attributes:
        scene: the scene.
        states: a batch of one: the contact solver's answer; where that moves although a solution on the
            true cones stands, that one.
        tip, slip: the two reserves of that state.
        redistribution: of the slip reserve: "tangential", or "full" where normal forces are not unique.
        verdict: whether every solution of the contact laws stands.
        reference_given: the reference moment of GN is the user's, not the support's.
        plot: the file of its picture, None for none.
        within: the worst of a tolerance; None: none was given.
        sensitivities: what changes would do; empty if not asked for.
        posture: of the robot whose scene this is; None: the scene is no robot's.
    """

    scene: Scene
    states: ContactStates
    tip: TipOverReserve
    slip: SlipReserve
    redistribution: Redistribution
    verdict: StabilityVerdict
    reference_given: bool = False
    plot: str | None = None
    within: WithinAtRest | None = None
    sensitivities: tuple[Sensitivity, ...] = ()
    posture: RestingPosture | None = None

    @property
    def state(self) -> ContactState:
        """The one state."""
        return self.states[0]

    @cached_property
    def equal(self) -> EqualSharing | None:
        """How equally compliant feet share the load; None where the sharing is unique or the base moves."""
        equal = equal_sharing(self.states)
        return equal if equal and np.isfinite(equal.GT[0]) else None

    @cached_property
    def friction_needed(self) -> float | None:
        """Factor on the friction with which the contacts just hold the base; None if it is not known."""
        if self.scene.planar or not self.state.solved:
            return None
        needed = friction_needed(self.scene.support, self.scene.wrench)
        return needed if np.isfinite(needed) else None

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
        return np.minimum(*ForceSets(self.scene.support).room(self.normal_forces))

    @cached_property
    def feet(self) -> Shared | None:
        """How feet that give share the load; None for rigid ones, or where the base does not rest."""
        elastic = self.scene.support.elastic
        shared = elastic.share(self.states.wrenches) if elastic and self.state.persistent else None
        return shared if shared and shared.found[0] else None

    @property
    def good(self) -> bool:
        """True if the base stands as described, and within its tolerance where there is one."""
        return self.stands and (self.within is None or self.within.stands)

    @property
    def stands(self) -> bool:
        """True if the base as described stands: all solutions of the contact laws do, as far as is known.

        With ordinary contacts this does not depend on the facets of the friction pyramids. Where rigid
        contacts leave it open, declared springs decide.
        """
        undecided = self.verdict.weak and not self.verdict.decided
        undecided &= self.verdict.state.persistent
        return self.state.solved and (self.verdict.strong or undecided or self.on_springs)

    @property
    def on_springs(self) -> bool:
        """Whether the forces of declared springs hold the base, within the friction."""
        return bool(self.feet and self.slip.GT[0] < _NO_RESERVE and not face_each_other(self.scene.support))

    @property
    def equal_remark(self) -> str:
        """What equally compliant feet do, where the best sharing of the load does something else."""
        if self.equal is None:
            return ""
        lifted = np.flatnonzero(self.equal.lifts[0]) + 1
        found = [f"contact {k} lifts" for k in lifted]
        found += [] if self.equal.stands[0] else ["the friction is not enough"]
        return f"with equally compliant feet {' and '.join(found)}" if found else ""

    @property
    def without_reserve(self) -> str:
        """What the least further load does to a base that just stands: "tips" or "slips"; else empty."""
        if not self.stands:
            return ""
        if self.tip.GN[0] >= _NO_RESERVE:
            return "tips"
        return "slips" if self.slip.GT[0] >= _NO_RESERVE else ""

    @property
    def remark(self) -> str:
        """Why the solver's state does not look like the verdict; else empty."""
        return state_remark(self.verdict, float(np.nanmax(np.append(self.slip.usage[0], 0.0))))

    def to_dict(self) -> dict[str, Any]:
        """Everything; contacts in the order of the file."""
        state = self.state
        axis, counterexample = _nearest_axis(self), self.verdict.counterexample
        return {
            "scene": self.scene.name,
            "persistent": self.stands,
            **({"within": self.within.to_dict()} if self.within else {}),
            "without_reserve": self.without_reserve or None,
            "solved": state.solved,
            "status": state.status,
            "stability": self.verdict.verdict,
            "stability_explanation": self.verdict.explanation,
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
            "friction_needed": self.friction_needed,
            "tipping_axis": axis,
            "wrench": self.scene.wrench,
            **sensitivities_to_dict(self.sensitivities),
            **({"posture": self.posture.to_dict()} if self.posture else {}),
            "residual": self.verdict.state.residual,
            "pivots": self.verdict.state.pivots,
            "versions": versions(),
        }

    def write(self) -> Iterator[Path]:
        """Draw the picture, if one is wanted."""
        if self.plot is not None:
            from ocptip.pictures.scene import plot_scene

            plot_scene(self.scene, self.states, self.tip, reported_slip(self.states, self.slip), self.plot)
            yield Path(self.plot)

    def to_text(self) -> str:
        """Verdict, contacts, reserves, evidence."""
        return "\n".join([*self._headline(), "", *self._contact_table(), "", *self._summary()])

    def _headline(self) -> list[str]:
        lost = self.stands and not self.good
        return [f"{self.scene.name}: {self._answer()}{' NOT WITHIN ITS TOLERANCE.' if lost else ''}"]

    def _answer(self) -> str:
        state = self.state
        if not state.solved and state.status != STATUS[BEYOND_RESOLUTION]:
            return f"NO ANSWER: {state.status}"
        if self.without_reserve:
            what = {"tips": "the least push tips it", "slips": "the least push makes it slip"}
            return f"IN BALANCE WITHOUT ANY RESERVE: {what[self.without_reserve]}."
        remark = f" Note: {self.equal_remark}." if self.equal_remark else ""
        if self.verdict.strong:
            return f"STANDS. Nothing slips, nothing lifts off.{remark}"
        if self.on_springs:
            return "STANDS on its feet as compliant as declared; rigid ones might move, see stability."
        if self.stands:
            return "STANDS in this solution, but that is not sure, see stability."
        if self.verdict.weak and self.equal and not remark:
            return "NOT SURE: equally compliant feet stand, rigid ones may move, see stability."
        if self.verdict.weak:
            return (
                f"NOT SURE: one solution of the contact laws stands, others may move, see stability.{remark}"
            )
        if not state.solved:
            return f"DOES NOT STAND: {state.status}."
        if state.persistent:
            return "DOES NOT STAND, see stability."
        moves = what_moves(self.scene.support, state.modes)
        return f"DOES NOT STAND. {moves[:1].upper()}{moves[1:]}."

    def _contact_table(self) -> list[str]:
        state, support = self.state, self.scene.support
        forces, reserves = without_noise(self.normal_forces), without_noise(self.normal_reserves)
        position = "position x, y [m]" if self.scene.planar else "position x, y, z [m]"
        rows = [["contact", "kind", position, "mode", "normal force", "friction used", "normal reserve"]]
        for k, contact in enumerate(support.contacts):
            where = ", ".join(f"{x:.3f}" for x in contact.position + 0.0)
            force, reserve = quantity(forces[k], "N"), quantity(reserves[k], "N")
            used = percent(self.friction_used[k])
            mode = "lifted" if self.feet and not self.feet.pressing[0, k] else state.modes[k]
            rows.append([str(k + 1), contact.kind, where, mode, force, used, reserve])
        return table(rows, left=(1, 3))

    def _summary(self) -> list[str]:
        rest = "" if self.reference_given else "; 0.09: the best at rest without load"
        state, solver, full = self.state, self.verdict.state, self.redistribution == "full"
        shared = "; normal forces shared in the best way" if full else ""
        of_it = "of it {} are the acceleration of what {}, m/s^2"  # beyond 1, where no ratio goes on
        lines = [("tip-over GN", f"{ratio(self.tip.GN[0])} (1: a contact lifts off{rest})")]
        if self.tip.lift_acceleration[0] > 0:
            lines.append(("", of_it.format(ratio(self.tip.lift_acceleration[0]), "lifts")))
        lines.append(("slip GT", f"{ratio(self.slip.GT[0])} (1: the friction is used up{shared})"))
        if self.slip.slide_acceleration[0] > 0:
            needed = f"; {needed_text(self.friction_needed)}" if self.friction_needed else ""
            lines.append(("", of_it.format(ratio(self.slip.slide_acceleration[0]), "slides") + needed))
        if self.equal:
            text = f"GT {ratio(self.equal.GT[0])}; the table has their normal forces and friction used"
            lines.append(("equal feet", f"{text}; `stiffness` declares other springs"))
        if self.remark:
            lines.append(("", self.remark))
        lines.append(("tipping axis", _axis_text(self)))
        if self.feet:
            lines.append(("feet", _feet_text(self.feet)))
        lines += self.posture.rows() if self.posture else []
        lines += under("within", self.within.lines() if self.within else ())
        lines += under("would change", self.sensitivities)
        only = " Under exactly this load; there is no reserve." if self.without_reserve else ""
        lines.append(("stability", f"{self.verdict.verdict}: {self.verdict.explanation}{only}"))
        if solver.solved and not solver.persistent and not self.stands:
            values = ", ".join(f"{a:.3g}" for a in without_noise(solver.acceleration))
            which = " in the solution that moves" if self.verdict.weak else ""
            lines.append(("acceleration", f"[{values}] m/s^2, rad/s^2{which}"))
        lines.append(("solver", f"{solver.pivots} pivots, residual {solver.residual:.1g} (relative)"))
        if state.solved and not self.slip.solved[0]:
            lines.append(("note", f"slip reserve: {self.slip.status[0]}"))
        return named(lines)


def check_plot_target(target: str) -> None:
    """Raise InputError for a file that could not be written, before anything is computed."""
    path = Path(target)
    if path.suffix.lower() not in PLOT_FORMATS:
        raise InputError(f"--plot: expected a file name ending in {', '.join(PLOT_FORMATS)}, got {target!r}")
    if path.is_dir():
        raise InputError(f"--plot: {target} is a directory")
    if not path.parent.is_dir():
        raise InputError(f"--plot: no such directory: {path.parent}")


def _nearest_axis(report: StandReport) -> dict[str, Any] | None:
    index = int(report.tip.nearest_axis[0])
    axes = report.tip.tip_over.axes
    if not 0 <= index < len(axes):
        return None
    axis = axes[index]
    return {
        "contacts": [k + 1 for k in axis.contacts],
        "point": axis.point,
        "direction": axis.direction,
        "moment_reserve": report.tip.moments[0, index],
    }


def _feet_text(feet: Shared) -> str:
    """How far they are pressed in."""
    depths = np.maximum(-1e3 * feet.deflections[0, :, 0], 0.0)
    least, most = (quantity(depth, "mm", 3) for depth in (depths.min(), depths.max()))
    return f"give by {least} to {most}; forces are those of their springs on level ground"


def _axis_text(report: StandReport) -> str:
    axis = _nearest_axis(report)
    if axis is None:
        free = report.tip.tip_over.free_rotation
        return "none: nothing resists a rotation" if free else "none: the base cannot tip about its contacts"
    through = " and ".join(str(k) for k in sorted(set(axis["contacts"])))
    noun = "contacts" if len(set(axis["contacts"])) > 1 else "contact"
    return f"nearest through {noun} {through}, moment reserve {quantity(axis['moment_reserve'], 'N m')}"
