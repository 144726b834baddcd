"""Plans MotionBenchMaker problems along paths, and checks the motions on raw meshes; goes on.

    python -m studies.mbm.run FOLDER --urdf panda.urdf --srdf panda.srdf --numbers 1-5 --out OUT

FOLDER holds `problems/<family>_<robot>/`. One row per problem is appended to
OUT/mbm_<robot>_<uncertainty>.jsonl.
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import coal
import numpy as np
import pinocchio as pin

from ocptip.api.tasks import load_task
from ocptip.basics.errors import InputError, PlanningError
from ocptip.basics.interrupts import TimeIsUpError
from ocptip.certificate.checks import certified
from ocptip.motion.files.execution import execute
from ocptip.motion.paths.search import search_path
from ocptip.motion.task import MotionTask
from ocptip.motion.violations import sentence
from ocptip.numerics.time_limit import interrupted_after
from ocptip.retiming.among import NODES
from ocptip.retiming.retime import retime
from ocptip.trajectories.trajectory import Trajectory
from studies.mbm.problems import FAMILIES, ROBOTS, Robot, task_of

CLEARANCE = 0.001
"""m: the goals are grasps, whose fingers are millimetres from what they hold."""

SEARCH, PROOF = 150.0, 120.0
"""s of wall time, on a machine that is shared: the CPU seconds of each stage are written."""


def main() -> None:
    """Run what is missing."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--robot", default="panda", choices=sorted(ROBOTS))
    parser.add_argument("--urdf", type=Path, required=True)
    parser.add_argument("--srdf", type=Path)
    parser.add_argument("--numbers", default="1-5", help="first and last problem of each family")
    parser.add_argument("--uncertainty", default="workshop", help="within which limits hold: none, workshop")
    parser.add_argument("--out", type=Path, default=Path("studies/results"))
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    file = options.out / f"mbm_{options.robot}_{options.uncertainty}.jsonl"
    done = {(row["family"], row["number"]) for row in rows_of(file)}
    first, last = map(int, options.numbers.split("-"))
    files = {"urdf": str(options.urdf.resolve())}
    if options.srdf:
        files["srdf"] = str(options.srdf.resolve())
    for number in range(first, last + 1):
        for family in FAMILIES:
            if (family, number) in done:
                continue
            text = task_of(options.folder / "problems", family, options.robot, number, files)
            row = {
                "family": family,
                "number": number,
                **solved(text, options.uncertainty, ROBOTS[options.robot], options.urdf, options.srdf),
            }
            with file.open("a") as out:
                out.write(json.dumps(row) + "\n")
            print(json.dumps(row), flush=True)


def rows_of(file: Path) -> list[dict[str, Any]]:
    """The rows of a file, if there is one."""
    return [json.loads(line) for line in file.read_text().splitlines()] if file.exists() else []


class Stages:
    """CPU seconds of each stage, and of all before the proof."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}

    def run(self, name: str, compute: Callable[[], Any]) -> Any:
        """The result of a stage."""
        began = time.process_time()
        try:
            return compute()
        finally:
            self.seconds[name] = round(time.process_time() - began, 3)


def solved(text: str, uncertainty: str, kind: Robot, urdf: Path, srdf: Path | None) -> dict[str, Any]:
    """One problem: search alone, timing, what a controller runs, proof, checks by others."""
    stages, row = Stages(), dict[str, Any]()
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "task.toml"
        file.write_text(f"{text}\n[limits]\nclearance = {CLEARANCE}\n")
        task = stages.run("read", partial(load_task, file, uncertainty=uncertainty))
    own = task.segments[0].task
    robot, limits = own.robot, own.limits
    row["cpu_s"] = stages.seconds
    try:
        end = time.perf_counter() + SEARCH
        fit = stages.run("search", partial(search_path, own, deadline=end))
    except (InputError, PlanningError) as error:
        return row | {"outcome": "no path", "why": f"{error}"[:200]}
    row["path_rad"] = float(np.sum(np.linalg.norm(np.diff(fit.samples, axis=0), axis=1)))
    try:
        timed = stages.run("timing", lambda: retime(robot, fit.path, limits, own.objective, nodes=NODES))
        run = stages.run("execution", lambda: execute(robot, timed.motion, limits, "cubic", first=1.004))
    except InputError as error:
        return row | {"outcome": "no timing", "why": f"{error}"[:200]}
    row |= {"duration_s": run.motion.end, "energy_J": run.check.energy}
    row["clearance_mm"] = 1e3 * run.check.worst["clearance_m"].value
    if not run.check.verified:
        return row | {"outcome": "limits broken", "why": "; ".join(map(sentence, run.check.violations))[:200]}
    try:
        with interrupted_after(PROOF):
            proved = stages.run("proof", lambda: certified(robot, run.motion, run.check, limits))
        row["outcome"] = "proved" if proved.certified else "checked"
    except TimeIsUpError:
        row["outcome"] = "checked (proof out of time)"
    row |= by_toppra(own, fit.path)
    row["mesh_contacts_at_1_ms"] = on_raw_meshes(own, run.motion, kind, urdf, srdf)
    return row


def by_toppra(task: MotionTask, path: Any) -> dict[str, Any]:
    """Duration of toppra's timing of the same path, and whether a contact is lost."""
    import toppra
    from toppra import algorithm, constraint

    toppra.setup_logging("ERROR")
    s = np.linspace(0, 1, 200)
    given = toppra.SplineInterpolator(s, path.at(s)[0])
    own = task.robot.limits
    limits = [
        constraint.JointVelocityConstraint(np.column_stack([-own.speed, own.speed])),
        constraint.JointAccelerationConstraint(np.column_stack([-own.acceleration, own.acceleration])),
    ]
    motion = algorithm.TOPPRA(limits, given, parametrizer="ParametrizeConstAccel").compute_trajectory()
    if motion is None:
        return {"toppra_s": None}
    times = np.linspace(0, motion.duration, 400)
    robot = task.robot.resting(0)
    _, wrenches = robot.loads(motion(times), motion(times, 1), motion(times, 2))
    lost = sum(not one.persistent for one in robot.contact_states(wrenches))
    return {"toppra_s": float(motion.duration), "toppra_loses_contact": bool(lost)}


def on_raw_meshes(task: MotionTask, motion: Trajectory, kind: Robot, urdf: Path, srdf: Path | None) -> int:
    """Instants, 1 ms apart, at which the meshes of the URDF touch obstacles or each other, by coal alone.

    Meshes of the robot that touch each other at the start are left out, such as wheels in their base.
    """
    model = pin.buildModelFromUrdf(str(urdf))
    folders = [str(folder) for folder in urdf.resolve().parents]
    geometry = pin.buildGeomFromUrdf(model, str(urdf), pin.GeometryType.COLLISION, package_dirs=folders)
    count = geometry.ngeoms
    for number, solid in enumerate(task.robot.around):
        shape = getattr(solid, "shape", None)
        if shape is None or not hasattr(shape, "position") or not hasattr(shape, "solid"):
            continue
        pose = pin.SE3(shape.rotation, shape.position - [0.0, 0.0, kind.deck])
        solid_of = exact(shape)
        if solid_of is not None:
            geometry.addGeometryObject(pin.GeometryObject(f"around{number}", 0, pose, solid_of))
    geometry.addAllCollisionPairs()
    if srdf is not None:
        pin.removeCollisionPairs(model, geometry, str(srdf))
    for pair in pairs_of(geometry):
        resting = [geometry.geometryObjects[k].parentJoint == 0 for k in (pair.first, pair.second)]
        parents = [geometry.geometryObjects[k].parentJoint for k in (pair.first, pair.second)]
        if all(resting) or (max(pair.first, pair.second) < count and neighbours(model, *parents)):
            geometry.removeCollisionPair(pair)
    data, placed = model.createData(), geometry.createData()
    joints = [model.joints[model.getJointId(name)] for name in task.robot.names]
    q, hits = pin.neutral(model), 0
    for joint, name in enumerate(model.names):
        if "finger" in name:
            q[model.joints[joint].idx_q] = kind.fingers

    def place(state: np.ndarray) -> None:
        for own, value in zip(joints, state, strict=True):  # continuous joints have cosine and sine
            q[own.idx_q : own.idx_q + own.nq] = value if own.nq == 1 else (np.cos(value), np.sin(value))

    place(task.start)
    pin.computeCollisions(model, data, geometry, placed, q, False)
    always = [result.isCollision() for result in placed.collisionResults]  # wheels in their base
    for touches, pair in zip(always, pairs_of(geometry), strict=True):
        if touches and max(pair.first, pair.second) < count:
            geometry.removeCollisionPair(pair)
    placed = geometry.createData()
    for state in motion(np.append(np.arange(0, motion.end, 1e-3), motion.end)):
        place(state)
        hits += pin.computeCollisions(model, data, geometry, placed, q, True)
    return int(hits)


def pairs_of(geometry: pin.GeometryModel) -> list[pin.CollisionPair]:
    """Copies of the pairs: those of the geometry change places when one is removed."""
    return [pin.CollisionPair(pair.first, pair.second) for pair in geometry.collisionPairs]


def neighbours(model: pin.Model, one: int, other: int) -> bool:
    """Whether two joints are the same, or one carries the other."""
    return one == other or model.parents[one] == other or model.parents[other] == one


def exact(shape: Any) -> Any:
    """The geometry of coal itself: a true cylinder, not the prism of the library."""
    kind = type(shape).__name__
    if kind == "Box":
        return coal.Box(*shape.size)
    if kind == "Cylinder":
        return coal.Cylinder(shape.radius, shape.length)
    return coal.Sphere(shape.radius) if kind == "Ball" else None


if __name__ == "__main__":
    main()
