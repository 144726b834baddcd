"""Contact physics: bindings, mode automata, the automaton-governed Lemke solver, stability verdicts."""

from ocptip.contact.automaton import Automaton, Mode, build_automaton
from ocptip.contact.binding import Binding, ForcePiece, PoolVariable
from ocptip.contact.clamps import (
    ForceConstantHalfRigidClamp,
    ForceConstantTwoSidedClamp,
    ForceVariableHalfRigidClamp,
    ForceVariableTwoSidedClamp,
    RigidClamp,
)
from ocptip.contact.solver import ContactState, ContactStates, solve, solve_many
from ocptip.contact.support import Load, Support
from ocptip.contact.unilateral import UnilateralContact

__all__ = [
    "Automaton",
    "Binding",
    "ContactState",
    "ContactStates",
    "ForceConstantHalfRigidClamp",
    "ForceConstantTwoSidedClamp",
    "ForcePiece",
    "ForceVariableHalfRigidClamp",
    "ForceVariableTwoSidedClamp",
    "Load",
    "Mode",
    "PoolVariable",
    "RigidClamp",
    "Support",
    "UnilateralContact",
    "build_automaton",
    "solve",
    "solve_many",
]
