"""Penetrations in a motion: Pinocchio and coal on the URDF's own meshes, without ocptip's solids.

Every solid and every triangle counts as the URDF has it (no hulls), pairs are chosen from the kinematic tree
anew: all but those of one body or of neighbours, those that are named, those of the SRDF, and those that
touch in each of many random postures.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from contextlib import chdir
from pathlib import Path
from typing import Any

import coal
import numpy as np
import pinocchio as pin

STEP = 1e-3
"""Spacing of the instants, s."""

POSTURES = 100
"""Random postures within the limits."""


class MeshCheck:
    """A URDF's collision geometry, the joints that do not move where they rest, and a deck under the arm.

    Args:
        urdf: the file.
        base_link: of the arm.
        names: of the joints that move, (n,).
        resting: values of the others, rad or m, by name; neutral where nothing is said.
        deck: edges and centre of a box, m, in the axes of `base_link`; None: none.
        excluded: pairs of links that do not count.
        srdf: file with more of them.
        package_dirs: folders for `package://` names, next to those above the URDF.

    Attributes:
        postures: random ones, (`POSTURES`, n), rad or m.
        colliding: how many of them collide.
        always: pairs of links that touch in each of them, left out.
    """

    def __init__(
        self,
        urdf: Path,
        base_link: str,
        names: Sequence[str],
        resting: Mapping[str, float],
        *,
        deck: tuple[Sequence[float], Sequence[float]] | None = None,
        excluded: Iterable[Sequence[str]] = (),
        srdf: Path | None = None,
        package_dirs: Sequence[Path] = (),
    ) -> None:
        urdf = urdf.resolve()
        self.model = pin.buildModelFromUrdf(str(urdf))
        self.data = self.model.createData()
        self.names, self.neutral = tuple(names), pin.neutral(self.model)
        for name, value in resting.items():
            self._put(self.neutral, name, value)
        folders = [str(folder.resolve()) for folder in (*package_dirs, *urdf.parents)]
        with chdir(urdf.parent):  # names of meshes may be relative to the file
            self.solids = pin.buildGeomFromUrdf(
                self.model, str(urdf), pin.GeometryType.COLLISION, package_dirs=folders
            )
        self._bodies = [self._body(item.parentJoint) for item in self.solids.geometryObjects]
        if deck is not None:
            self._add_deck(base_link, *deck)
        self._add_pairs({frozenset(pair) for pair in excluded}, srdf)
        self.postures = self._random_postures()
        self.pairs = [(pair.first, pair.second) for pair in self.solids.collisionPairs]
        hits = self._hits(self.postures)
        always = hits.all(axis=0)
        self.always = sorted({self._pair(k) for k in np.flatnonzero(always)})
        self.colliding = int(hits[:, ~always].any(axis=1).sum())
        self.pairs = [pair for pair, out in zip(self.pairs, always, strict=True) if not out]

    def motion(self, angles: np.ndarray) -> dict[str, Any]:
        """Instants of a motion (N, n), rad or m, that collide, and the pairs of links that do."""
        hits = self._hits(angles)
        pairs = sorted({self._pair(k) for k in np.flatnonzero(hits.any(axis=0))})
        return {"instants": len(angles), "colliding": int(hits.any(axis=1).sum()), "pairs": pairs}

    def _put(self, q: np.ndarray, name: str, value: float) -> None:
        joint = self.model.joints[self.model.getJointId(name)]
        turns = [value] if joint.nq == 1 else [np.cos(value), np.sin(value)]
        q[joint.idx_q : joint.idx_q + joint.nq] = turns

    def _body(self, joint: int) -> int:
        """Number of the last joint that moves on the way to a joint, 0: none."""
        above = {self.model.names[j] for j in self.model.supports[joint]}
        return max((k for k, name in enumerate(self.names, 1) if name in above), default=0)

    def _add_deck(self, base_link: str, size: Sequence[float], position: Sequence[float]) -> None:
        frame = self.model.frames[self.model.getFrameId(base_link, pin.FrameType.BODY)]
        place = frame.placement * pin.SE3(np.eye(3), np.array(position, dtype=float))
        deck = pin.GeometryObject("deck", frame.parentJoint, place, coal.Box(*map(float, size)))
        self.solids.addGeometryObject(deck)
        self._bodies.append(0)

    def _add_pairs(self, excluded: set[frozenset[str]], srdf: Path | None) -> None:
        for a in range(len(self._bodies)):
            for b in range(a + 1, len(self._bodies)):
                apart = frozenset((self._link(a), self._link(b))) in excluded
                if abs(self._bodies[a] - self._bodies[b]) > 1 and not apart:
                    self.solids.addCollisionPair(pin.CollisionPair(a, b))
        if srdf is not None:
            pin.removeCollisionPairs(self.model, self.solids, str(srdf))

    def _link(self, number: int) -> str:
        item = self.solids.geometryObjects[number]
        return "deck" if item.name == "deck" else self.model.frames[item.parentFrame].name

    def _pair(self, number: int) -> tuple[str, str]:
        first, second = self.pairs[int(number)]
        return self._link(first), self._link(second)

    def _random_postures(self) -> np.ndarray:
        limits = []
        for name in self.names:
            joint = self.model.joints[self.model.getJointId(name)]
            low = self.model.lowerPositionLimit[joint.idx_q] if joint.nq == 1 else -np.pi
            high = self.model.upperPositionLimit[joint.idx_q] if joint.nq == 1 else np.pi
            limits.append((max(low, -np.pi), min(high, np.pi)))
        low, high = np.array(limits).T
        return np.random.default_rng(14).uniform(low, high, (POSTURES, len(self.names)))

    def _hits(self, angles: np.ndarray) -> np.ndarray:
        """Which pairs collide, (N, pairs).

        With contacts: without them, as Pinocchio's computeCollisions asks, coal 3.0.3 misses 16 of 200
        overlaps of the two cylinders about Baxter's forearm, 46 mm deep.
        """
        placed, request, result = self.solids.createData(), coal.CollisionRequest(), coal.CollisionResult()
        request.enable_contact = True
        solids = [item.geometry for item in self.solids.geometryObjects]
        hits = np.zeros((len(angles), len(self.pairs)), dtype=bool)
        for state, values in enumerate(angles):
            q = self.neutral.copy()
            for name, value in zip(self.names, values, strict=True):
                self._put(q, name, float(value))
            pin.updateGeometryPlacements(self.model, self.data, self.solids, placed, q)
            poses = [coal.Transform3s(pose.rotation, pose.translation) for pose in placed.oMg]
            for k, (a, b) in enumerate(self.pairs):
                result.clear()
                hits[state, k] = coal.collide(solids[a], poses[a], solids[b], poses[b], request, result) > 0
        return hits
