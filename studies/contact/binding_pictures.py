"""Pictures of forces at rest and automaton of contacts (no options; writes into the results).

All kinds in the plane; in space the foot and the clamp of the published rig, with four facets.
"""

from __future__ import annotations

from ocptip.contact.bindings import clamps
from ocptip.contact.bindings.unilateral import UnilateralContact
from ocptip.pictures.bindings import binding_figure
from studies.common import RESULTS

AT = {"position": (0, 0), "normal": (0, 1)}
JAWS = {"friction_upper": 0.5, "friction_lower": 0.3}


def main() -> None:
    """Write them among the results."""
    bindings = [
        UnilateralContact(**AT, friction=0.5),
        clamps.RigidClamp(**AT, **JAWS),
        clamps.ForceConstantHalfRigidClamp(**AT, **JAWS, clamp_force=60.0),
        clamps.ForceVariableHalfRigidClamp(**AT, **JAWS, clamp_force=60.0),
        clamps.ForceConstantTwoSidedClamp(**AT, **JAWS, clamp_force=60.0, lever_ratio=1.5),
        clamps.ForceVariableTwoSidedClamp(**AT, **JAWS, clamp_force=60.0, lever_ratio=1.5),
    ]
    for binding in bindings:
        binding_figure(binding, 200.0).savefig(RESULTS / f"binding_{binding.kind}.png", dpi=70)
    spatial = [
        UnilateralContact(position=(0, 0, 0), friction=0.5, facets=4),
        clamps.ForceConstantHalfRigidClamp(position=(0, 0, 0), **JAWS, clamp_force=60.0, facets=4),
    ]
    for binding in spatial:
        binding_figure(binding, 200.0).savefig(RESULTS / f"binding_spatial_{binding.kind}.png", dpi=85)


if __name__ == "__main__":
    main()
