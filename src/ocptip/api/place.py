"""`ocptip.place`: where a base should stand for the poses of a task, and why not elsewhere."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from ocptip import pictures
from ocptip.basics.outputs import SavedFolder, remove_figures
from ocptip.placement.output import refusal_to_dict, result_to_dict, write_placement
from ocptip.placement.place import place as search
from ocptip.placement.problem import PlacementProblem
from ocptip.placement.result import NoPlacementError, Placement, PlacementResult
from ocptip.placement.within import placement_within, searched
from ocptip.standing.tolerance import DEFAULT, Uncertainty
from ocptip.standing.within.rest import WithinAtRest
from ocptip.task_files.placement import PlacementTask, load_placement
from ocptip.task_files.tables.tolerance import load_tolerance


def place(
    what: PlacementTask | PlacementProblem | str | os.PathLike[str],
    *,
    uncertainty: Uncertainty | str | None = None,
    starts: int = 5,
    seed: int = 0,
    progress: Callable[[int, int, float | None], None] | None = None,
) -> Placed:
    """Find the best distinct placements of a base.

    The result depends on the task and on the numbers only. One task runs in this process.

    Example::

        placed = ocptip.place("examples/tasks/place_incline.toml", starts=1)
        placed.best.base_position  # m, world axes

    Args:
        what: a placement file (docs/placement.md), the task that it holds, or a problem.
        uncertainty: an object, a preset ("workshop", "none") or a TOML file with a table `[tolerance]`.
            Default: that of the file or the problem, else "workshop".
        starts: nonlinear programs that are solved first.
        seed: of the sample of the ground.
        progress: called as progress(done, starts, minimum total so far or None).

    Raises:
        InputError: the file or a value cannot be used; one line.
    """
    if isinstance(what, PlacementTask):
        task = what
    elif isinstance(what, PlacementProblem):
        task = PlacementTask("placement", what, what.tolerance)
    else:
        task = load_placement(what, DEFAULT)
    task.problem.robot.require_no_objects("place")
    if uncertainty is not None:
        task = task.within(load_tolerance(uncertainty))
    how = {"starts": starts, "seed": seed, "progress": progress}
    if (alike := task.problem.if_alike) is None:
        return _placed(task, **how)
    if (placed := _placed(replace(task, problem=alike), **how)).verified:
        return placed
    # Another sharing of the load may hold the base where equally compliant contacts slip.
    placed = _placed(task, **how)
    if not placed.found:
        return placed
    return replace(placed, alike=placement_within(replace(placed.best, problem=alike), task.tolerance))


def _placed(task: PlacementTask, **how: Any) -> Placed:
    """Placements that keep all limits, those alone that hold the whole uncertainty if there are any."""
    try:
        answer = search(task.problem, **how)
    except NoPlacementError as error:
        return Placed(task.name, error)
    if searched(task.tolerance) == task.tolerance:
        return Placed(task.name, answer)
    return _holding(task.name, answer, task.tolerance)


def _holding(name: str, answer: PlacementResult, tolerance: Uncertainty) -> Placed:
    """The placements that hold the whole tolerance, the first one's worst, and how many do not; else all."""
    checks = [placement_within(placement, tolerance) for placement in answer.placements]
    kept = [k for k, one in enumerate(checks) if one.stands]
    if not kept:
        return Placed(name, answer, checks[0], len(checks))
    placements = tuple(answer.placements[k] for k in kept)
    return Placed(name, replace(answer, placements=placements), checks[kept[0]], len(checks) - len(kept))


@dataclass(frozen=True, eq=False, repr=False)
class Placed(SavedFolder):
    """Placements, or why there are none.

    Attributes:
        name: of the task.
        answer: the placements, the best first; or the error that says which constraint cannot be met.
        within: the best one at the worst of an uncertainty of more than its base; None: none was given.
        dropped: placements that do not hold that uncertainty.
        alike: the best one if its contacts are equally compliant, where these keep the limits nowhere; None:
            they do, and are rated so, or only one sharing of the load counts.
    """

    name: str
    answer: PlacementResult | NoPlacementError
    within: WithinAtRest | None = None
    dropped: int = 0
    alike: WithinAtRest | None = None

    @property
    def found(self) -> bool:
        """True if a placement keeps all constraints."""
        return isinstance(self.answer, PlacementResult)

    @property
    def verified(self) -> bool:
        """True if a placement keeps all constraints, within the whole uncertainty where there is one."""
        return self.found and (self.within is None or self.within.stands)

    @property
    def best(self) -> Placement:
        """The best placement; without one that keeps all constraints the nearest to that."""
        return self.answer.best if isinstance(self.answer, PlacementResult) else self.answer.nearest

    @property
    def places(self) -> tuple[Placement, ...]:
        """All distinct placements; without one the nearest."""
        return self.answer.places if isinstance(self.answer, PlacementResult) else (self.answer.nearest,)

    def __repr__(self) -> str:
        """The verdict, where the best one is, and its total."""
        x, y, z = self.best.base_position + 0.0
        if not self.found:
            return f"<Placed {self.name}: no placement: {self.answer}>"
        verdict = "verified" if self.verified else "not within the uncertainty"
        others = f"{len(self.places) - 1} alternatives"
        where = f"base at ({x:.3f}, {y:.3f}, {z:.3f}) m"
        return f"<Placed {self.name}: {verdict}, {where}, total {self.best.total:.4g}; {others}>"

    def to_dict(self) -> dict[str, Any]:
        """The content of placement.json."""
        if isinstance(self.answer, PlacementResult):
            data = result_to_dict(self.name, self.answer)
        else:
            data = refusal_to_dict(self.name, self.answer)
        data |= {"within": self.within.to_dict(), "dropped": self.dropped} if self.within else {}
        return data | ({"if_feet_give_alike": self.alike.to_dict()} if self.alike else {})

    def write(
        self, folder: str | os.PathLike[str], *, figures: bool = True, extra: Mapping[str, Any] | None = None
    ) -> Iterator[Path]:
        """Write the files and yield each path when its file is complete; `extra` adds entries to
        placement.json.
        """
        folder = Path(folder)
        yield write_placement(folder, {**self.to_dict(), **(extra or {})})
        remove_figures(folder, "place")
        if figures:
            yield from pictures.placement.draw_placement(folder, self.name, self.places)
