"""Search for a moving solution of ordinary contacts in general position, on Coulomb's true cones.

Branch-and-bound as in `mode_search`, but without facets: a node says of each contact that it may do anything,
separates, sticks, or slides with a direction in an arc. Sticking forces lie in the cone itself (second
order); sliding forces in the polygon around the arc, which shrinks as the arc is halved. So a node's program
has a solution wherever the node holds a motion, and an exhausted search proves that there is none. Candidates
are refined by Newton's method on the laws themselves (`cone_motion`).
"""

from __future__ import annotations

import clarabel
import numpy as np

from ocptip.contact.cone_motion import SEPARATE, SLIDE, STICK, ConeProblem, MotionSearch
from ocptip.contact.mode_search import EXHAUSTED, FOUND, LIMIT, MOTION_TOLERANCE
from ocptip.contact.states import ContactState
from ocptip.numerics.cone_program import INFEASIBLE, USABLE, quiet_settings, solve_cones

_ANYTHING = "anything"
_ARC_PARTS = 3
_NARROWEST = 1e-3  # rad
_REST = 1e-9
_NARROW = 0.5  # rad: from arcs this narrow on Newton's method is tried

_Choice = tuple[str, float, float]  # what a contact does; start and width of its arc of sliding directions


def find_cone_motion(problem: ConeProblem, max_programs: int) -> MotionSearch:
    """Search for a solution that moves, of ordinary contacts in any position.

    Args:
        problem: contacts and wrench.
        max_programs: limit of the number of convex programs.
    """
    if not np.any(problem.load):
        return MotionSearch(EXHAUSTED, None, 0)
    return _Search(problem).run(max_programs)


class _Search:
    """Depth first. The acceleration `a` of the base lies in the ball a'Ma <= load'a (forces dissipate)."""

    def __init__(self, problem: ConeProblem) -> None:
        self.problem = problem
        root = np.linalg.cholesky(problem.mass_matrix)
        # y = root' a, so that y'y = a'Ma and the ball is |y - half| <= |half|
        self.to_motion = np.linalg.inv(root.T)
        self.half = 0.5 * np.linalg.solve(root, problem.load)
        self.size = float(np.linalg.norm(self.half))
        self.least = MOTION_TOLERANCE * (2 * self.size) ** 2
        self.contacts = problem.contact_wrenches.swapaxes(1, 2) @ self.to_motion  # (n, 3, 6) velocities per y

    def run(self, max_programs: int) -> MotionSearch:
        stack: list[list[_Choice]] = [[(_ANYTHING, 0.0, 2 * np.pi)] * len(self.contacts)]
        programs, resolution = 0, 0.0
        while stack:
            node = stack.pop()
            if programs >= max_programs:
                widths = [w for choice in [*stack, node] for what, _, w in choice if what == SLIDE]
                return MotionSearch(LIMIT, None, programs, max([resolution, *widths]))
            programs += 1
            point = self._relaxation(node)
            if point is None:
                continue
            y, forces = point
            k, state = self._worst(node, y, forces), None
            # Newton's method is tried where all contacts obey their laws, or arcs are narrow enough to start
            # it.
            if k is None or all(w <= _NARROW for what, _, w in node if what == SLIDE):
                state = self._candidate(node, y, forces)
            if state is not None:
                return MotionSearch(FOUND, state, programs)
            # The relaxation obeys all laws, yet no exact motion came of it: any contact that can be divided
            # is.
            if k is None:
                k = next((i for i, choice in enumerate(node) if _parts(choice)), None)
            parts = _parts(node[k]) if k is not None else []
            if k is None or not parts:
                resolution = max([resolution, _NARROWEST])
                continue
            for part in parts:
                stack.append([*node[:k], part, *node[k + 1 :]])
        return MotionSearch(LIMIT if resolution else EXHAUSTED, None, programs, resolution)

    def _relaxation(self, node: list[_Choice]) -> tuple[np.ndarray, np.ndarray] | None:
        """Motion y (6,) of maximum power and contact forces (n, 3) in a node; None if it holds no motion.

        Unknowns: y, then per contact its sliding rates and force coefficients.
        """
        pushes, equations, inequalities, cones = [], [], [], []
        size = 6
        blocks = []
        for k, choice in enumerate(node):
            rates, forces = _columns(choice, self.problem.friction[k])
            blocks.append((k, choice[0], size, rates, forces))
            size += rates.shape[1] + forces.shape[1]
        balance = np.zeros((6, size))
        balance[:, :6] = np.eye(6)
        signs = []
        for k, what, index, rates, forces in blocks:
            at_force = index + rates.shape[1]
            balance[:, at_force : at_force + forces.shape[1]] = -self.contacts[k].T @ forces
            rows = np.zeros((3, size))
            rows[:, :6] = self.contacts[k]
            rows[1:, index:at_force] = -rates
            if what in (STICK, SLIDE):
                equations.append(rows[:1])
            else:
                inequalities.append(-rows[:1])  # it may lift off, and lifts off in any direction
            if what == STICK or rates.shape[1]:
                equations.append(rows[1:])
            if what in (_ANYTHING, STICK):
                cone = np.zeros((3, size))
                cone[:, at_force : at_force + 3] = -np.diag(np.array([self.problem.friction[k], 1.0, 1.0]))
                cones.append(cone)
                if self.problem.friction[k] == 0:
                    signs += [at_force]
            else:
                signs += range(index, at_force + forces.shape[1])
            pushes.append((at_force, forces))
        positive = np.zeros((len(signs), size))
        positive[np.arange(len(signs)), signs] = -1.0
        ball = np.zeros((7, size))
        ball[1:, :6] = -np.eye(6)
        equations = np.vstack([balance, *equations])
        inequalities = np.vstack([positive, *inequalities])
        A = np.vstack([equations, inequalities, *cones, ball])
        b = np.zeros(len(A))
        b[:6], b[-7], b[-6:] = 2 * self.half, self.size, -self.half
        cost = np.zeros(size)
        cost[:6] = -2 * self.half
        kinds = [
            clarabel.ZeroConeT(len(equations)),
            clarabel.NonnegativeConeT(len(inequalities)),
            *[clarabel.SecondOrderConeT(3)] * len(cones),
            clarabel.SecondOrderConeT(7),
        ]
        solution = solve_cones(cost, A, b, kinds, quiet_settings(1e-10))
        status = str(solution.status)
        if status in INFEASIBLE:
            return None
        if status not in USABLE:
            return np.zeros(6), np.zeros((len(node), 3))  # not decided: the node is split further
        x = np.asarray(solution.x)
        if 2 * self.half @ x[:6] <= self.least:
            return None
        return x[:6], np.array([forces @ x[index : index + forces.shape[1]] for index, forces in pushes])

    def _worst(self, node: list[_Choice], y: np.ndarray, forces: np.ndarray) -> int | None:
        """The contact that breaks its laws most, of those that can be split; None if none breaks them."""
        u = self.contacts @ y
        speed = np.linalg.norm(u[:, 1:], axis=1)
        dissipated = self.problem.friction * forces[:, 0] * speed + np.sum(u[:, 1:] * forces[:, 1:], axis=1)
        violation = np.maximum(
            np.minimum(np.abs(u[:, 0]), forces[:, 0]), dissipated / np.maximum(speed, 1e-3)
        )
        violation[[not _parts(choice) for choice in node]] = 0.0
        k = int(np.argmax(violation))
        return k if violation[k] > _REST else None

    def _candidate(self, node: list[_Choice], y: np.ndarray, forces: np.ndarray) -> ContactState | None:
        u = self.contacts @ y
        slides = np.linalg.norm(u[:, 1:], axis=1) > 1e-6 * np.linalg.norm(y)
        what = []
        for (chosen, *_), lift, slide, force in zip(node, u[:, 0], slides, forces, strict=True):
            if chosen == _ANYTHING:
                chosen = SEPARATE if lift > force[0] else SLIDE
            what.append(STICK if chosen == SLIDE and not slide else chosen)
        problem = self.problem
        motion = self.to_motion @ y * np.r_[np.ones(3), np.full(3, 1 / problem.support.length)]
        return problem.motion(what, motion * problem.unit / problem.support.mass, forces * problem.unit)


def _parts(choice: _Choice) -> list[_Choice]:
    """What a choice consists of; empty if it is not split further."""
    what, start, width = choice
    if what == _ANYTHING:
        return [(SLIDE, 0.0, 2 * np.pi), (STICK, 0.0, 0.0), (SEPARATE, 0.0, 0.0)]
    if what != SLIDE or width <= _NARROWEST:
        return []
    return [(SLIDE, start, width / 2), (SLIDE, start + width / 2, width / 2)]


def _columns(choice: _Choice, friction: float) -> tuple[np.ndarray, np.ndarray]:
    """Sliding rates (2, r) and forces (3, f) whose non-negative combinations a choice allows."""
    what, start, width = choice
    if what in (_ANYTHING, STICK):
        return np.zeros((2, 0)), np.eye(3)
    if what == SEPARATE:
        return np.zeros((2, 0)), np.zeros((3, 0))
    parts = 8 if width > 4 else _ARC_PARTS
    angles = start + width * np.r_[0.0, (np.arange(parts) + 0.5) / parts, 1.0]
    radius = np.r_[1.0, np.full(parts, 1 / np.cos(width / (2 * parts))), 1.0]
    directions = np.array([np.cos(angles), np.sin(angles)])
    forces = np.vstack([np.ones(parts + 2), -friction * radius * directions])
    rates = directions[:, [0, len(angles) // 2, -1]] if width <= 4 else directions[:, 1:-1]
    return rates, forces
