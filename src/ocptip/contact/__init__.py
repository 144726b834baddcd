"""Contact physics: bindings, mode automata, the automaton-governed Lemke solver, stability verdicts."""

from ocptip.contact.bindings.automaton import Automaton, Mode, build_automaton
from ocptip.contact.bindings.binding import Binding, ForcePiece, PoolVariable
from ocptip.contact.bindings.clamps import (
    ForceConstantHalfRigidClamp,
    ForceConstantTwoSidedClamp,
    ForceVariableHalfRigidClamp,
    ForceVariableTwoSidedClamp,
    RigidClamp,
)
from ocptip.contact.bindings.unilateral import UnilateralContact
from ocptip.contact.solver import ContactState, ContactStates, solve, solve_many
from ocptip.contact.support import Load, Support
from ocptip.contact.verdict import Equilibrium, StabilityVerdict, equilibrium, stability

__all__ = [
    "Automaton",
    "Binding",
    "ContactState",
    "ContactStates",
    "Equilibrium",
    "ForceConstantHalfRigidClamp",
    "ForceConstantTwoSidedClamp",
    "ForcePiece",
    "ForceVariableHalfRigidClamp",
    "ForceVariableTwoSidedClamp",
    "Load",
    "Mode",
    "PoolVariable",
    "RigidClamp",
    "StabilityVerdict",
    "Support",
    "UnilateralContact",
    "build_automaton",
    "equilibrium",
    "solve",
    "solve_many",
    "stability",
]
