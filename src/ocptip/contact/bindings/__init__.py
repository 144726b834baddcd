"""One file per kind of contact, with what all share: pyramid, modes, automaton, laws.

Kinds register themselves where they are defined: all files of this folder are loaded with it.
"""

from importlib import import_module
from pkgutil import iter_modules

for _module in iter_modules(__path__, f"{__name__}."):
    import_module(_module.name)
