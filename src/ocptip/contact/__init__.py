"""Contact physics: contact models, mode automata, the automaton-governed Lemke solver, stability verdicts."""

from ocptip.contact.bindings.binding import Binding
from ocptip.contact.bindings.clamps import (
    ForceConstantHalfRigidClamp,
    ForceConstantTwoSidedClamp,
    ForceVariableHalfRigidClamp,
    ForceVariableTwoSidedClamp,
    RigidClamp,
)
from ocptip.contact.bindings.unilateral import UnilateralContact
from ocptip.contact.bindings.wheel import DrivenWheel, FreeWheel
from ocptip.contact.solver import solve, solve_many
from ocptip.contact.support import Load, Support
from ocptip.contact.verdict import stability

__all__ = [
    "Binding",
    "DrivenWheel",
    "ForceConstantHalfRigidClamp",
    "ForceConstantTwoSidedClamp",
    "ForceVariableHalfRigidClamp",
    "ForceVariableTwoSidedClamp",
    "FreeWheel",
    "Load",
    "RigidClamp",
    "Support",
    "UnilateralContact",
    "solve",
    "solve_many",
    "stability",
]
