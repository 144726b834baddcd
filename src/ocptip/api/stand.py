"""`ocptip.stand`: everything about one scene, or about a robot that rests in a posture."""

from __future__ import annotations

import os
from dataclasses import replace
from typing import TYPE_CHECKING

from numpy.typing import ArrayLike

from ocptip.api.inputs.worst_scene import worst_of_scene
from ocptip.api.results.stand import Standing
from ocptip.basics.errors import InputError, naming
from ocptip.contact.verdict import stability, standing_state
from ocptip.reserves.slip import Slip
from ocptip.reserves.tipping import TipOver
from ocptip.standing.tolerance import NONE, Uncertainty
from ocptip.task_files.scene import Scene, read_scene
from ocptip.task_files.tables.tolerance import load_tolerance

if TYPE_CHECKING:
    from ocptip.api.inputs.postures import RestingPosture
    from ocptip.motion.cycles.task import CycleTask
    from ocptip.motion.task import MotionTask
    from ocptip.robots.base_motion import BaseMotion
    from ocptip.standing.mechanism import StandingMechanism


def stand(
    what: Scene | MotionTask | CycleTask | StandingMechanism | RestingPosture | str | os.PathLike[str],
    q: ArrayLike | str | None = None,
    *,
    uncertainty: Uncertainty | str | None = None,
    reference_moment: float | None = None,
    sensitivities: bool = False,
    base_motion: BaseMotion | None = None,
) -> Standing:
    """Return whether a base is stable under its loads, with forces, margins and the evidence.

    Example::

        ocptip.stand("examples/scenes/pushed_cart.toml").stable

    Args:
        what: a scene or its file; or a task, its file, the folder of a plan, or a robot,
            which rests in a posture.
        q: the posture of a robot: (n,), rad (straight coordinates: m), or a name in the task ("start",
            "goal", a segment). With a posture a file is a task file.
        uncertainty: the worst case that the base has to stand, an object, a preset ("workshop", "none") or a
            TOML file with a table `[tolerance]`. Default: that of the file or the task.
        reference_moment: N m, M0 of GN; of scenes only, robots have one.
        sensitivities: whether to compute what would help; not on a base that drives.
        base_motion: acceleration and turning of the base of a robot that drives; default: it rests.

    Raises:
        InputError: a file, a value or a name cannot be used; one line.
    """
    posture = None
    if isinstance(what, str | os.PathLike) and q is None:
        what = read_scene(what)
    if isinstance(what, Scene):
        if q is not None or base_motion is not None:
            name = "q" if base_motion is None else "base_motion"
            raise InputError(f"{name}: belongs to a robot; a scene has none")
        scene = what
    else:
        from ocptip.api.inputs.postures import resting_posture  # loads for 0.3 s what scenes do not need

        if reference_moment is not None:
            raise InputError(
                "reference_moment: of a scene; a robot in a posture has a reference moment already"
            )
        posture = resting_posture(what, q)
        posture = posture if base_motion is None else posture.driving(base_motion)
        scene = posture.scene
    tolerance = scene.tolerance if uncertainty is None else load_tolerance(uncertainty)
    return _solved(scene, posture, tolerance, reference_moment, sensitivities)


def _solved(
    scene: Scene,
    posture: RestingPosture | None,
    tolerance: Uncertainty,
    reference: float | None,
    wants_sensitivities: bool,
) -> Standing:
    support, slip = scene.support, Slip(scene.support)
    within, sensitivities = None, ()
    if posture is not None:
        within = posture.within(tolerance)
    elif tolerance.given:
        with naming(scene.name):
            within = worst_of_scene(scene, tolerance, reference)
    verdict = stability(support, scene.wrench)
    state = verdict.state
    if verdict.weak and state.solved and not state.persistent:
        state = standing_state(verdict) or state
    states = state.states
    tip_over = TipOver(support, reference) if posture is None else posture.robot.tip_over
    objects = ()
    if posture is not None:
        objects = tuple(
            replace(
                _solved(carried, None, NONE, None, False),
                within=posture.object_within(carried.name, tolerance),
            )
            for carried in posture.objects
        )
    if wants_sensitivities and posture is not None:
        sensitivities = posture.sensitivities(tolerance)
    elif wants_sensitivities:
        from ocptip.standing.at_rest.sensitivity import scene_sensitivities

        sensitivities = scene_sensitivities(support, scene.loads, reference, tolerance)
    return Standing(
        scene=scene,
        states=states,
        tip=tip_over.evaluate(states),
        slip=slip.evaluate(states, derivatives=False),
        redistribution=slip.redistribution,
        verdict=verdict,
        reference_given=reference is not None,
        within=within,
        sensitivities=sensitivities,
        tolerance=tolerance,
        posture=posture,
        objects=objects,
    )
