"""Energy and CPU time of simulated parallel robots on springs.

    python -m studies.parallel.simulation [ROBOT...] [--seconds T]

Springs at the motors pull the robot to its home pose, where they carry its weight; it starts with a push.
Energy of bodies and springs must stay what it is. The springs' forces need the motors' positions, which the
study finds from the pose by Newton's method apart from the simulation; their time is not counted.
"""

from __future__ import annotations

import argparse
import time

import numpy as np

from ocptip.parallel.code.complete import complete_joints, newton_function
from ocptip.parallel.description.ready_made import READY_MADE
from ocptip.parallel.robot import ParallelRobot
from ocptip.parallel.simulation import simulate
from ocptip.task_files.parallel import read_parallel_robot
from studies.common import EXAMPLES

ROBOTS = ("6UPS", "five_bar", "rps3", "prs3", "tricept", "exechon", "sps6")
_FREQUENCY, _SPEED = 3.0, 0.3  # Hz; m/s and rad/s


class Springs:
    """Motor law of springs at the motors, and their energy.

    Attributes:
        seconds: CPU time spent here.
        began: CPU time at the first call, when the equations are made.
    """

    def __init__(self, robot: ParallelRobot) -> None:
        home, legs = robot.description.home, robot.kinematics.legs
        q = robot.ik(home).q
        firsts = np.cumsum([0, *(leg.n for leg in legs)])
        self._motors = [int(firsts[leg]) + joint for leg, joint in robot.description.actuated]
        self._newton = newton_function(robot.kinematics, 3).expand()
        self._q = complete_joints(robot.kinematics, home, q)
        self._home = self._q[self._motors]
        rest = np.zeros(robot.m)
        self._carry = robot.inverse_dynamics(home, rest, rest, q).motors
        inverse = np.linalg.inv(robot.jacobian(home, q))
        mass = inverse.T @ robot.mass_matrix(home, q) @ inverse
        self._stiffness = (2 * np.pi * _FREQUENCY) ** 2 * mass
        self.seconds, self.began = 0.0, 0.0

    def force(self, t: float, z: np.ndarray, s: np.ndarray) -> np.ndarray:
        """(n_a,) motor forces."""
        begin = time.process_time()
        self.began = self.began or begin
        force = self._carry - self._stiffness @ self._stretch(z)
        self.seconds += time.process_time() - begin
        return force

    def energy(self, z: np.ndarray) -> float:
        """J."""
        stretch = self._stretch(z)
        return float(0.5 * stretch @ self._stiffness @ stretch - self._carry @ stretch)

    def _stretch(self, z: np.ndarray) -> np.ndarray:
        q, gap = self._newton(z, self._q)
        if not float(gap) < 1e-11:
            raise ValueError(f"the legs do not close at {z.tolist()}")
        self._q = np.array(q).ravel()
        return self._q[self._motors] - self._home


def drift(robot: ParallelRobot, seconds: float, step: float = 0.001) -> tuple[float, float, float]:
    """Energy drift relative to the largest kinetic energy, largest way of a coordinate, and CPU seconds per
    second."""
    springs = Springs(robot)
    push = _SPEED * np.random.default_rng(1).uniform(-1, 1, robot.m)
    home = robot.description.home
    path = simulate(robot, home, push, duration=seconds, step=step, motors=springs.force)
    cpu = time.process_time() - springs.began - springs.seconds
    springs = Springs(robot)
    total = path.energy.sum(axis=1) + np.array([springs.energy(z) for z in path.z])
    error = np.abs(total - total[0]).max() / path.energy[:, 0].max()
    return float(error), float(np.abs(path.z - home).max()), cpu / seconds


def main() -> None:
    """Print one line per robot."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("robots", nargs="*", default=ROBOTS)
    parser.add_argument("--seconds", type=float, default=10.0)
    options = parser.parse_args()
    print("robot      energy drift   way (m, rad)   CPU s per s")
    for name in options.robots:
        ready = READY_MADE.get(name)
        path = EXAMPLES / "robots" / f"{name}.toml"
        robot = ParallelRobot(ready() if ready else read_parallel_robot(path))
        error, way, cpu = drift(robot, options.seconds)
        print(f"{name:10s} {error:12.1e} {way:14.3f} {cpu:13.3f}", flush=True)


if __name__ == "__main__":
    main()
