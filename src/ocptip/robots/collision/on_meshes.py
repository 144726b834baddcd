"""What convex solids hide: links whose solids always overlap, checked again on the meshes in them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np

from ocptip.robots.collision.distances import Distances
from ocptip.robots.collision.gaps import POSTURES, random_postures
from ocptip.robots.collision.model import always_touching, link_frames_function, solids_of
from ocptip.robots.collision.shapes import ArmGeometry, MeshFile
from ocptip.robots.kinematics import link_frames
from ocptip.robots.model import ArmModel
from ocptip.robots.pinocchio import load_coal


@dataclass(frozen=True, eq=False)
class Raw:
    """A geometry as its file has it.

    Attributes:
        name: of the link.
        body: see `BodyShape`.
        geometry: of coal, a mesh's triangles for example.
        rotation, position: (3, 3) and (3,), m: its pose in the link's frame; of body 0 in the mount frame.
        mesh: its file; None: no mesh.
    """

    name: str
    body: int
    geometry: Any
    rotation: np.ndarray
    position: np.ndarray
    mesh: MeshFile | None = None


def touches_on_meshes(arm: ArmModel, geometry: ArmGeometry, raw: Sequence[Raw]) -> dict[frozenset[str], int]:
    """In how many of `POSTURES` random postures links touch on their meshes.

    Of those links, neither neighbours nor excluded, some of whose convex solids touch in all of them.
    """
    shapes = geometry.shapes
    pairs = [
        (a, b)
        for b in range(len(shapes))
        for a in range(b)
        if abs(shapes[a].body - shapes[b].body) > 1
        and frozenset((shapes[a].name, shapes[b].name)) not in geometry.apart
    ]
    solids = [(body, shape) for _, body, shape in solids_of(arm, geometry)]
    distances = Distances(link_frames_function(arm), solids, pairs)
    found = {frozenset(shapes[s].name for s in pairs[k]) for k in always_touching(arm, distances)}
    if not found:
        return {}
    coal, frames = load_coal(), link_frames(arm, random_postures(arm, POSTURES))
    request, result = coal.CollisionRequest(), coal.CollisionResult()
    request.enable_contact = True  # without it coal 3.0.3 misses some overlaps of cylinders

    def pose(item: Raw, state: int) -> Any:
        turn, origin = arm.mount_rotation, arm.mount_position
        if item.body:
            turn, origin = frames.rotations[state, item.body - 1], frames.origins[state, item.body - 1]
        return coal.Transform3s(turn @ item.rotation, origin + turn @ item.position)

    def touch(first: Raw, second: Raw, state: int) -> bool:
        result.clear()
        poses = pose(first, state), pose(second, state)
        return coal.collide(first.geometry, poses[0], second.geometry, poses[1], request, result) > 0

    counts = {}
    for names in sorted(found, key=sorted):
        own = [[item for item in raw if item.name == name] for name in sorted(names)]
        hits = (any(touch(a, b, state) for a, b in product(*own)) for state in range(POSTURES))
        counts[names] = sum(hits)
    return counts
