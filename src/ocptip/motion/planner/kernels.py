"""Kernels of the planner, loaded or compiled where this is imported.

For the process that workers are forked from, see `ocptip.numerics.fork_server`: workers then have them when
they begin, and on the first run it compiles them while the command itself compiles the contact solver.
"""

from __future__ import annotations

from contextlib import suppress

from ocptip.motion.planner import node_physics, profile_kernels
from ocptip.reserves import planar

ARGUMENTS = {
    profile_kernels.put_corners: "f1 i1 i f2 f2 f2 f3",
    profile_kernels.put_passive_corners: "f i1 f1 f1 f b1 f2 f2 f3 f3 f2",
    profile_kernels.joint_states: "f1 f2 f3 f3 f f1 f1 f2 f2 f3 f3 i1 i1 i i",
    profile_kernels.over_all_variables: "i1 f2 f4 f2 i2 i2 i1 f2",
    profile_kernels.slopes_at_all_nodes: "f2 f4 f2 i2 i2 i1 f2",
    profile_kernels.add_curvature: "f2 f2 f4 f2 i2 i2 i1 f1 f2",
    profile_kernels.add_second_derivatives: "f2 f2 f4 f2 f3 f3 i2 i1 i1 f2 f1 f2 f2 f2",
    profile_kernels.add_corners_curvature: "f2 f1 i1 i f2 i1 i f2 f2 f2",
    node_physics._join: "f2 f2 i i i",
    node_physics._over_states: "i1 i1 f2 f2 i",
    node_physics._add_bends: "f2 i1 f3",
    node_physics._add_bends_over_quantities: "f2 i1 i f3 f2 i",
    node_physics._weigh: "f2 f2 f2 i i",
    node_physics._bend: "f2 f2 f2 f2 f2 f1 i i",
    planar._usages: "f2 f2 f2 f1 f3 b f2 f3",
}
"""By kernel: see `Kernel.prepare`."""

with suppress(OSError):  # a full disk, for instance: then each worker compiles what it calls
    for _kernel, _arguments in ARGUMENTS.items():
        _kernel.prepare(_arguments)
