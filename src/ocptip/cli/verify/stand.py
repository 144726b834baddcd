"""`ocptip stand`: everything about one scene."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ocptip.api.results.stand import Standing
from ocptip.api.stand import stand
from ocptip.basics.errors import InputError
from ocptip.basics.text import (
    NOISE,
    joint_words,
    margin_text,
    percent,
    quantity,
    ratio,
    some,
    table,
    towards,
    without_noise,
)
from ocptip.cli.layout import brief_notes, changes_table, fitted, headlines, under
from ocptip.cli.options import GatedReport, gate_of, given_tolerance, read_gate
from ocptip.contact.elastic import Shared
from ocptip.contact.resting import what_moves
from ocptip.contact.states import BEYOND_RESOLUTION, STATUS
from ocptip.standing.at_rest.slope import FloorSlope
from ocptip.task_files.scene import read_scene

if TYPE_CHECKING:
    from ocptip.api.inputs.postures import RestingPosture
    from ocptip.standing.within.design import Design

PLOT_FORMATS = (".png", ".pdf", ".svg")


def run(options: Namespace) -> StandReport:
    """Solve the scene; evaluate its margins and its stability."""
    if options.plot is not None:
        check_plot_target(options.plot)
    read_gate(options)
    if options.posture is None:
        for name in ("base_acceleration", "base_turning"):
            if getattr(options, name) is not None:
                raise InputError(f"--{name.replace('_', '-')}: needs --posture; a scene has no robot")
        if Path(options.scene).is_dir():
            raise InputError("is a folder; that of a plan needs --posture start or goal", "", options.scene)
        what = read_scene(options.scene)
        tolerance = what.tolerance
    else:
        from ocptip.cli.verify.stand_posture import read_posture  # loads for 0.3 s what scenes do not need

        what = read_posture(options)
        tolerance = what.scene.tolerance
    tolerance = given_tolerance(options) or tolerance
    try:
        result = stand(
            what,
            uncertainty=tolerance,
            reference_moment=options.gn_reference,
            sensitivities=options.sensitivities,
        )
    except InputError as error:
        if error.path != "reference_moment":
            raise
        raise InputError(str(error).replace("reference_moment", "--gn-reference")) from None
    design = result.smallest_design if options.design else None
    return StandReport(result, options.plot, design, **gate_of(options, result))


@dataclass
class StandReport(GatedReport):
    """The report of `ocptip stand` on a scene.

    Attributes:
        found: what is known.
        plot: the file of its picture, None for none.
        design: the smallest base, if it is asked for.
    """

    result: Standing
    plot: str | None = None
    design: Design | None = None

    @property
    def kept(self) -> bool:
        """True if the base is stable and the arm can rest in its posture."""
        return self.result.stable and not self.broken

    @property
    def broken(self) -> Sequence[str]:
        """Why the arm cannot rest in its posture: torques, angles, clearance."""
        return self.result.posture.refusals if self.result.posture else ()

    def to_dict(self) -> dict[str, Any]:
        """Everything; contacts in the order of the file."""
        design = {"design": self.design.to_dict()} if self.design else {}
        return {**self.result.to_dict(), **design, **self.gate_to_dict()}

    def write(self) -> Iterator[Path]:
        """Draw the picture and write the report for pipelines, if they are wanted."""
        if self.plot is not None:
            yield self.result.save(self.plot)
        yield from super().write()

    def to_text(self) -> str:
        """Verdict, margins, contacts; with -v the indices and the evidence."""
        rows = fitted([*self._margins(), *under("Required", self.outcomes)])
        objects = self._object_table() if self.result.objects else []
        changes = changes_table(self.result.sensitivities, "What if")
        head = headlines(self.headline)
        parts = [[*head, *rows], objects, self._contact_table(), changes, fitted(self._summary())]
        return "\n\n".join("\n".join(part) for part in parts if part)

    @property
    def headline(self) -> str:
        """Name of the scene and verdict."""
        result = self.result
        lost = result.nominally_stable and not result.stable_itself
        about = f" WITHIN {result.within.scope.upper()}" if result.within and result.stable else ""
        if about and _left_out_overshoot(result):
            about += ", AT CONSTANT ACCELERATION"
        if about and not all(carried.within for carried in result.objects):
            about += ", OBJECTS IN THE NOMINAL MODEL ONLY"
        verdict, _, remark = self._answer().partition(".")
        verdict += " NOMINALLY, NOT WITHIN ITS UNCERTAINTY" if lost else about
        lacking = [o for o in result.objects if not (o.nominally_stable if lost else o.stable_itself)]
        if result.nominally_stable and (names := [carried.scene.name for carried in lacking]):
            join, be = "AND" if lost else "BUT", "IS" if len(names) == 1 else "ARE"
            verdict += f", {join} {some(names, 3)} {be} NOT STABLE{' AT ALL' if lost else ''}"
        if self.broken:
            verdict += f", {'BUT' if result.stable else 'AND'} THE ARM CANNOT REST THERE"
        return f"{result.scene.name}   {verdict}.{remark[:2].upper()}{remark[2:]}"

    def _answer(self) -> str:
        result = self.result
        state = result.state
        if not state.solved and state.status != STATUS[BEYOND_RESOLUTION]:
            return f"NO ANSWER. {state.status}"
        if result.without_reserve:
            what = {"tips": "any push tips it", "slips": "any push makes it slip"}
            return f"IN BALANCE WITHOUT ANY MARGIN. {what[result.without_reserve].capitalize()}."
        remark = f" Note: {result.equal_remark}." if result.equal_remark else ""
        if result.verdict.strong:
            return f"STABLE.{remark}"
        if result.on_springs:
            return "STABLE on its compliant feet. Rigid ones might move, see stability."
        if result.nominally_stable:
            return "STABLE in this solution. Others are possible, see stability."
        if result.verdict.weak and result.equal and not remark:
            return "NOT SURE. Equally compliant feet are stable, rigid ones may move, see stability."
        if result.verdict.weak:
            return (
                f"NOT SURE. One solution of the contact laws is stable, others move, see stability.{remark}"
            )
        if not state.solved:
            return f"NOT STABLE. {state.status}."
        if state.persistent:
            return "NOT STABLE. See stability."
        moves = what_moves(result.scene.support, state.modes)
        return f"NOT STABLE. {moves[:1].upper()}{moves[1:]}."

    def _margins(self) -> list[tuple[str, str]]:
        """What the arm cannot hold, and the margins against tipping and sliding."""
        result = self.result
        rows = [*under("Broken", self.broken), ("Tipping margin", _axis_text(result))]
        if np.isfinite(result.slip.GT[0]):
            full = result.redistribution == "full"
            used = _share_text(result.slip.GT[0])
            if result.slip.slide_acceleration[0] > 0 and (demand := result.friction_demand):
                used = demand.used
            rows.append(("Friction used", used + (", shared optimally" if full else "")))
        if result.equal:
            used = _share_text(result.equal.GT[0])
            text = f"{used} with equally compliant feet, as in the table; `stiffness` declares other springs"
            rows.append(("", text))
        forces = without_noise(result.normal_reserves)
        if np.isfinite(forces).any():
            k = int(np.nanargmin(np.where(np.isfinite(forces), forces, np.nan)))
            rows.append(("Min foot force", f"{quantity(max(forces[k], 0.0), 'N')} (contact {k + 1})"))
        best = result.equal and not result.equal.stands[0]
        case = "nominal, with the best sharing of the load" if best else "nominal"
        if result.largest_slope:
            rows.append(("Max slope", _slope_text(result.largest_slope, case)))
        if result.posture:
            rows += under("Max push", _push_texts(result.posture, case))
        if largest := result.largest_payload:
            scope = f"within {result.tolerance.title}" if result.tolerance.given else "nominal"
            rows.append(("Max payload", f"{largest}; all that hangs at the TCP, {scope}, limits kept"))
        if result.posture and (share := result.possible_process) is not None:
            scope = f"within {result.tolerance.title}" if result.tolerance.given else "nominal"
            rows.append(("Process", f"{result.posture.process}: {share}, {scope}"))
        return rows

    def _object_table(self) -> list[str]:
        """Margins of the base and of each object, nominal and in the worst case, the critical one marked."""
        result, critical = self.result, self.result.critical
        within = any(carried.within for carried in result.objects)
        titles = ["tipping margin", "friction used"]
        rows = [["", *titles, "min normal force", *(f"{t}, worst case" for t in titles if within), ""]]
        for carried in (result, *result.objects):
            axis, reference, worst = (
                carried.nearest_axis,
                carried.tip.tip_over.reference_moment,
                carried.within,
            )
            row = ["base" if carried is result else carried.scene.name]
            row.append(quantity(axis["moment_reserve"], "N m", 3) if axis else "-")
            row.append(_share_text(carried.slip.GT[0]))
            row.append(quantity(float(np.min(carried.normal_forces)), "N", 3))
            if within and worst:
                row += [quantity(worst.tipping_margin(reference), "N m", 3) if reference else "-"]
                row += [quantity(100 * worst.GT, "%", 3) if worst.GT <= 1 else worst.demand.used]
            elif within:
                row += ["-", "-"]
            mark = "" if carried.stable_itself else "NOT STABLE"
            mark += ", worst case" if mark and carried.nominally_stable else ""
            rows.append([*row, f"{mark} <- critical".lstrip() if carried is critical else mark])
        return table(rows, left=(0, len(rows[0]) - 1))

    def _contact_table(self) -> list[str]:
        result = self.result
        state, support = result.state, result.scene.support
        forces, reserves = without_noise(result.normal_forces), without_noise(result.normal_reserves)
        position = "position x, y [m]" if result.scene.planar else "position x, y, z [m]"
        rows = [["contact", "kind", position, "mode", "normal", "friction", "margin"]]
        for k, contact in enumerate(support.contacts):
            where = ", ".join(f"{x:.3f}" for x in np.asarray(contact.position) + 0.0)
            force, reserve = quantity(forces[k], "N"), quantity(reserves[k], "N")
            used = percent(result.friction_used[k])
            mode = "lifted" if result.feet and not result.feet.pressing[0, k] else state.modes[k]
            rows.append([str(k + 1), contact.kind, where, mode, force, used, reserve])
        return table(rows, left=(1, 3))

    def _summary(self) -> list[tuple[str, str]]:
        result = self.result
        state, solver = result.state, result.verdict.state
        lines = self._indices() if self.verbose else []
        if result.remark:
            lines.append(("note", result.remark))
        if result.feet:
            lines.append(("feet", _feet_text(result.feet)))
        if result.posture:
            lines += _posture_rows(result.posture)
        if result.within:
            lines += under("uncertainty", result.within.lines(result.tip.tip_over.reference_moment))
        if more := _left_out_overshoot(result):
            text = (
                "this is while the base accelerates evenly; where the acceleration begins or ends at once, "
            )
            text += f"up to {1 + more:.3g} times as much acts for a moment (damping of the uncertainty)"
            lines.append(("note", f"{text}; ocptip drive with the same --posture has the limits with that"))
        if self.design:
            lines += under("design", self.design.lines(result.scene.support))
        elif not result.stable and state.solved and not result.scene.planar:
            also = "" if result.sensitivities else "; --sensitivities: what helps"
            lines.append(("next", f"--design: how wide or heavy the base must be{also}"))
        only = " Under exactly this load; there is no margin." if result.without_reserve else ""
        if self.verbose or only or not result.verdict.strong:
            lines.append(("stability", f"{result.verdict.verdict}: {result.verdict.explanation}{only}"))
            lines += under("", filter(None, [result.unsure_cause]))
        if solver.solved and not solver.persistent and not result.nominally_stable:
            values = ", ".join(f"{a:.3g}" for a in without_noise(solver.acceleration))
            which = " in the solution that moves" if result.verdict.weak else ""
            lines.append(("acceleration", f"[{values}] m/s^2, rad/s^2{which}"))
        if self.verbose:
            lines.append(("solver", f"{solver.pivots} pivots, residual {solver.residual:.1g} (relative)"))
        if state.solved and not result.slip.solved[0]:
            lines.append(("note", f"friction used: {result.slip.status[0]}"))
        if result.posture:
            lines += under("assumed", brief_notes(result.posture.robot.notes, self.verbose))
        return lines

    def _indices(self) -> list[tuple[str, str]]:
        """Tip-over index and friction utilisation as published."""
        result = self.result
        rest = "" if result.reference_given else "; 0.09: the best at rest without load"
        beyond = "of it {} are the acceleration of what {}, m/s^2"  # beyond 1, where no ratio goes on
        lines = [("tip-over GN", f"{ratio(result.tip.GN[0])} (1: a contact lifts{rest})")]
        if result.tip.lift_acceleration[0] > 0:
            lines.append(("", beyond.format(ratio(result.tip.lift_acceleration[0]), "lifts")))
        lines.append(("slip GT", f"{ratio(result.slip.GT[0])} (1: the friction is used up)"))
        if result.slip.slide_acceleration[0] > 0:
            lines.append(("", beyond.format(ratio(result.slip.slide_acceleration[0]), "slides")))
        if (other := result.classical) is not None:
            point = 1e3 * float(other.zero_moment_point)
            angles = zip(np.degrees(other.static_angles), result.tip.tip_over.edges, strict=True)
            static = [
                f"{quantity(angle, 'deg', 3)} ({' and '.join(map(str, edge))})" for angle, edge in angles
            ]
            along = " and ".join(f"{100 * share:.0f} %" for share in other.load_transfer)
            lines.append(("classical", f"zero-moment point {quantity(point, 'mm', 3)} from the edge"))
            lines.append(("", f"static angle over the edge of contacts: {', '.join(static)}"))
            lines.append(("", f"force-angle measure {quantity(float(other.force_angle), 'rad N m', 3)}"))
            unit = "kg^2 m^4/s^2" if other.moment_height > 0 else "1/s^2"
            lines.append(("", f"moment-height measure {quantity(float(other.moment_height), unit, 3)}"))
            lines.append(("", f"load transfer {along} along x and y"))
        return lines


def _left_out_overshoot(standing: Standing) -> float:
    """Share by which a step of the base's acceleration overshoots within the uncertainty; 0: it has none."""
    motion = standing.posture.base_motion if standing.posture else None
    accelerates = motion is not None and motion.rows(1)[0].reshape(3, 3)[[0, 2]].any()
    return standing.tolerance.overshoot if accelerates else 0.0


def _posture_rows(posture: RestingPosture) -> list[tuple[str, str]]:
    """Joint values, base motion and torques at rest."""
    robot, torques = posture.robot, posture.instant.torques[0]
    rows = [("posture", joint_words(robot.names, robot.units, posture.q))]
    rows += [("note", posture.choice)] if posture.choice else []
    if (motion := posture.base_motion) is not None:
        parts = zip(motion.rows(1)[0].reshape(3, 3), ("m/s^2", "rad/s", "rad/s^2"), strict=True)
        shown = [
            f"({', '.join(f'{x:.4g}' for x in part + 0.0)}) {unit}" for part, unit in parts if part.any()
        ]
        rows.append(("base drives", f"{', '.join(shown) or 'without acceleration'}, base axes"))
    shares = np.abs(torques) / robot.limits.torque
    joint = int(np.argmax(shares))
    if shares[joint] > 0:
        holds = quantity(torques[joint], robot.motor_units[joint] if robot.motor_units else "N m")
        rows.append(("torque", f"{holds}, {percent(shares[joint])} of the limit ({robot.names[joint]})"))
    return rows


def check_plot_target(target: str) -> None:
    """Raise InputError for a file that could not be written, before anything is computed."""
    path = Path(target)
    if path.suffix.lower() not in PLOT_FORMATS:
        raise InputError(f"--plot: expected a file name ending in {', '.join(PLOT_FORMATS)}, got {target!r}")
    if path.is_dir():
        raise InputError(f"--plot: {target} is a directory")
    if not path.parent.is_dir():
        raise InputError(f"--plot: no such directory: {path.parent}")


def _share_text(share: float) -> str:
    """A share of the friction; rounding noise is zero."""
    if share > 1:
        return "more than all of it"
    return quantity(100 * share if share > NOISE else 0.0, "%", 3)


def _push_texts(posture: RestingPosture, case: str) -> Iterator[str]:
    """The largest pushes at the TCP, in any direction and horizontal, and the first contact to lift."""
    push, level, lift = posture.largest_push, posture.largest_horizontal_push, posture.first_lift
    if push is None or level is None or push.row < 0:
        return
    yield f"{quantity(push.level, 'N')} at the TCP, {case}, {push.how}"
    if level.row >= 0:
        yield f"horizontal: {quantity(level.level, 'N')} {level.how}"
    if lift is not None:
        conditions = ["if friction held"] * (lift.force > level.level)
        conditions += [] if posture.robot.support.elastic else ["if equally compliant"]
        force = f"{quantity(lift.force, 'N')} {towards(np.array(lift.towards))}"
        yield ", ".join([f"contact {lift.contact} lifts first, at {force}", *conditions])


def _slope_text(slope: FloorSlope, case: str) -> str:
    """The largest slope of the floor, and what happens beyond it."""
    angle = quantity(float(np.degrees(slope.angle)), "deg", 3)
    if not slope.loss:
        return f">= {angle} of the floor in any direction, {case}"
    about = " if its feet are equally compliant" * slope.alike
    about += f" about contacts {' and '.join(map(str, slope.contacts))}" if slope.contacts else ""
    downhill = f"downhill {towards(slope.downhill)}"
    also = ""
    if slope.loss != "tips" and slope.tips is not None:
        tips = quantity(float(np.degrees(slope.tips)), "deg", 3)
        also = f", if friction held it would tip at {tips} in its worst direction"
    return f"{angle} of the floor, {case}, {downhill}; beyond it the base {slope.loss}{about}{also}"


def _feet_text(feet: Shared) -> str:
    """How far they are pressed in."""
    depths = np.maximum(-1e3 * feet.deflections[0, :, 0], 0.0)
    least, most = (quantity(depth, "mm", 3) for depth in (depths.min(), depths.max()))
    return f"compressed by {least} to {most}; forces are those of their springs on level ground"


def _axis_text(standing: Standing) -> str:
    axis = standing.nearest_axis
    if axis is None:
        free = standing.tip.tip_over.free_rotation
        return "none: nothing resists a rotation" if free else "unlimited: no tipping axis"
    through = " and ".join(str(k) for k in sorted(set(axis["contacts"])))
    noun = "contacts" if len(set(axis["contacts"])) > 1 else "contact"
    # Friction and inertia of a base that slides change its normal forces.
    slides = standing.slip.slide_acceleration[0] > 0 and axis["moment_reserve"] >= 0
    moves = ", of the base as it slides" if slides else ""
    about = f"(axis through {noun} {through}{moves})"
    margin, _, missing = margin_text(axis["moment_reserve"], "N m", 4).partition(": ")
    return f"{margin} {about}{missing and f': {missing}'}"
